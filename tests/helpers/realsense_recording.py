"""A file of librealsense as its recorder writes it, of a software device: the pipeline plays it like a camera."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dlokit.types.image import DepthImage

DEPTH_UNIT_M = 0.001


def record(rs: Any, path: Path, images: Sequence[DepthImage], *, depth_from_colour_m: float = 0.0) -> None:
    """Write images as a depth and a colour stream to a .db3 file; `rs` is the module pyrealsense2.

    The depth sensor is beside the colour sensor by `depth_from_colour_m` [m]; both have the images' intrinsics.
    """
    device = rs.software_device()
    device.register_info(rs.camera_info.name, "software device")
    device.register_info(rs.camera_info.serial_number, "0042")
    sensors, profiles, opened = {}, {}, {}
    for number, (name, stream, form) in enumerate(
        (("Depth", rs.stream.depth, rs.format.z16), ("Color", rs.stream.color, rs.format.rgb8))
    ):
        sensors[name] = device.add_sensor(name)
        profiles[name] = sensors[name].add_video_stream(_stream(rs, images[0], stream, form, number))
    sensors["Depth"].add_read_only_option(rs.option.depth_units, DEPTH_UNIT_M)
    shift = rs.extrinsics()
    shift.rotation = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    shift.translation = [depth_from_colour_m, 0.0, 0.0]
    profiles["Depth"].register_extrinsics_to(profiles["Color"], shift)
    device.create_matcher(rs.matchers.default)
    recorder = rs.recorder(str(path), device)
    queue = rs.frame_queue(200)
    for sensor in recorder.query_sensors():
        opened[sensor.get_info(rs.camera_info.name)] = sensor
        sensor.open(sensor.get_stream_profiles()[0])
        sensor.start(queue)
    for number, image in enumerate(images):
        depth = np.round(image.depth_m / DEPTH_UNIT_M).astype(np.uint16)
        for name, pixels, width in (("Depth", depth, 2), ("Color", image.pixels, 3)):
            frame = rs.software_video_frame()
            frame.stride, frame.bpp = pixels.shape[1] * width, width
            frame.timestamp, frame.domain = number * 1000.0 / 30.0, rs.timestamp_domain.hardware_clock
            frame.frame_number, frame.profile = number, profiles[name].as_video_stream_profile()
            frame.pixels = np.ascontiguousarray(pixels)
            if name == "Depth":
                frame.depth_units = DEPTH_UNIT_M
            sensors[name].on_video_frame(frame)
        time.sleep(0.005)  # the recorder writes on a thread of its own, and drops what it cannot take
    for sensor in opened.values():
        sensor.stop()
        sensor.close()


def _stream(rs: Any, image: DepthImage, kind: Any, form: Any, number: int) -> Any:
    camera = image.calibration
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = kind, 0, number, form
    stream.width, stream.height, stream.fps = camera.width_px, camera.height_px, 30
    stream.bpp = 2 if form == rs.format.z16 else 3
    lens = rs.intrinsics()
    lens.width, lens.height = camera.width_px, camera.height_px
    lens.ppx, lens.ppy, lens.fx, lens.fy = camera.cx_px, camera.cy_px, camera.fx_px, camera.fy_px
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream.intrinsics = lens
    return stream
