"""Messages with pictures become the arrays that were sent, or are refused with what is taken."""

import struct

import cv2
import numpy as np
import pytest
import ros2_messages as ros
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.errors import HardwareError
from dlokit.extras.ros2.pictures.camera_info import (
    InfoOf,
    calibration_of,
    info_topic,
    is_rectified,
    pair_calibration_of,
)
from dlokit.extras.ros2.pictures.clouds import camera_in_frame, picture_of
from dlokit.extras.ros2.pictures.images import colour_of, depth_of, is_colour, is_depth
from dlokit.geometry import pose, rotation
from dlokit.geometry.camera import back_project, centred_camera, rays
from dlokit.types.image import CameraCalibration

RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 255, (6, 8, 3), dtype=np.uint8)
T = pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))
CAMERA = centred_camera(8, 6, 10.0, T)
VIEW = centred_camera(64, 48, 60.0, T)
ORIGIN = pose((0.0, 0.0, 0.0))
few = settings(max_examples=30, deadline=None, derandomize=True, database=None)


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[..., ::-1]),
        ("rgba8", np.dstack([RGB, RGB[..., :1]])),
        ("bgra8", np.dstack([RGB[..., ::-1], RGB[..., :1]])),
    ],
)
@pytest.mark.parametrize("padding", [0, 5])
def test_colours_are_decoded_from_every_encoding(encoding: str, pixels: NDArray[np.uint8], padding: int) -> None:
    found = colour_of(ros.image(pixels, encoding, padding=padding), "/c")
    np.testing.assert_array_equal(found, RGB)
    assert found.flags.c_contiguous


def test_grey_pictures_become_colours() -> None:
    np.testing.assert_array_equal(colour_of(ros.image(RGB[..., 0], "mono8"), "/c"), np.dstack([RGB[..., 0]] * 3))


@pytest.mark.parametrize("encoding", ["16UC1", "mono16"])
@pytest.mark.parametrize("big", [False, True])
@few
@given(steps=arrays(np.uint16, (4, 5)), padding=st.integers(0, 9))
def test_depths_in_millimetres_become_metres(encoding: str, big: bool, steps: NDArray[np.uint16], padding: int) -> None:
    depth_m = depth_of(ros.image(steps, encoding, padding=padding, big=big), "/d")
    np.testing.assert_array_equal(np.round(depth_m.astype(np.float64) * 1000.0), steps)
    assert depth_m.dtype == np.float32


@pytest.mark.parametrize("big", [False, True])
def test_depths_in_metres_are_zero_where_unknown(big: bool) -> None:
    sent = np.array([[0.5, np.nan, np.inf], [-np.inf, -1.0, 2.5]], dtype=np.float32)
    np.testing.assert_array_equal(
        depth_of(ros.image(sent, "32FC1", big=big, padding=2), "/d"), [[0.5, 0.0, 0.0], [0.0, 0.0, 2.5]]
    )


def test_other_encodings_are_refused_with_those_that_are_taken() -> None:
    with pytest.raises(HardwareError, match=r"/c have the encoding 'bayer_rggb8'; taken are rgb8, bgr8, .*mono8"):
        colour_of(ros.image(RGB[..., 0], "bayer_rggb8"), "/c")
    with pytest.raises(HardwareError, match=r"/d have the encoding 'rgb8'; taken are 16UC1"):
        depth_of(ros.image(RGB, "rgb8"), "/d")


@pytest.mark.parametrize("change", [{"step": 23}, {"height": 7}, {"width": 9}, {"height": 0}])
def test_a_picture_with_too_few_bytes_is_damaged(change: dict[str, int]) -> None:
    message = ros.image(RGB, "rgb8")
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(HardwareError, match="/c is damaged"):
        colour_of(message, "/c")


def png(picture: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    return cv2.imencode(".png", picture)[1].tobytes()


@pytest.mark.parametrize(
    ("form", "written"),
    [
        ("bgr8; png compressed bgr8", RGB[..., ::-1]),
        ("rgb8; png compressed bgr8", RGB[..., ::-1]),
        ("rgb8; png compressed rgb8", RGB),  # written without turning RGB to OpenCV's order
        ("png", RGB[..., ::-1]),
    ],
)
def test_compressed_colours_have_the_order_of_their_format(form: str, written: NDArray[np.uint8]) -> None:
    np.testing.assert_array_equal(colour_of(ros.compressed(png(written), form), "/c/compressed"), RGB)


def test_jpeg_is_decompressed() -> None:
    flat = np.full((48, 64, 3), (200, 100, 50), dtype=np.uint8)
    data = cv2.imencode(".jpg", flat[..., ::-1])[1].tobytes()
    found = colour_of(ros.compressed(data, "rgb8; jpeg compressed bgr8"), "/c/compressed")
    assert np.abs(found.astype(int) - flat).max() < 10  # JPEG is lossy


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"no picture",
        png(RGB)[:60],
        png(RGB)[:16] + struct.pack(">II", 60000, 60000) + png(RGB)[24:],
        b"\xff\xd8\xff\xc0\x00\x11\x08\xff\xff\xff\xff" + bytes(50),
    ],
    ids=["empty", "text", "cut", "huge PNG", "huge JPEG"],
)
def test_a_damaged_or_huge_compressed_picture_is_refused(data: bytes) -> None:
    with pytest.raises(HardwareError, match="cannot be decompressed; taken are PNG and JPEG"):
        colour_of(ros.compressed(data, "jpeg"), "/c/compressed")


STEPS = np.array([[0, 500, 1000], [2000, 65535, 1]], dtype=np.uint16)


@pytest.mark.parametrize("form", ["16UC1; compressedDepth png", "16UC1; compressedDepth"])
def test_compressed_depths_in_millimetres(form: str) -> None:
    message = ros.compressed(struct.pack("<iff", 0, 0.0, 0.0) + png(STEPS), form)
    np.testing.assert_allclose(depth_of(message, "/d/compressedDepth"), STEPS / 1000.0, rtol=1e-6)


def test_depths_in_a_plain_png_are_millimetres() -> None:
    np.testing.assert_allclose(depth_of(ros.compressed(png(STEPS), "16UC1; png compressed "), "/d"), STEPS / 1000.0)


def test_compressed_depths_in_metres_are_quantised_by_their_inverse() -> None:
    # As compressed_depth_image_transport: quantisation 100 at 10 m.
    depth_m = np.array([[0.0, 0.5, 1.0], [2.0, 5.0, 9.0]])
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
    steps = np.zeros(depth_m.shape, dtype=np.uint16)
    steps[depth_m > 0.0] = (a / depth_m[depth_m > 0.0] + b).astype(np.uint16)
    message = ros.compressed(struct.pack("<iff", 0, a, b) + png(steps), "32FC1; compressedDepth png")
    # A step is depth² / a: 0.8 % of 9 m.
    np.testing.assert_allclose(depth_of(message, "/d/compressedDepth"), depth_m, rtol=2e-3)


def test_other_compressions_of_depth_are_refused() -> None:
    with pytest.raises(HardwareError, match="'16UC1; compressedDepth rvl'; taken is PNG"):
        depth_of(ros.compressed(bytes(64), "16UC1; compressedDepth rvl"), "/d/compressedDepth")
    with pytest.raises(HardwareError, match="one channel of 16 bits"):
        depth_of(ros.compressed(png(RGB), "16UC1; png compressed"), "/d/compressed")
    with pytest.raises(HardwareError, match="colours are needed"):
        colour_of(ros.compressed(bytes(64), "16UC1; compressedDepth png"), "/d/compressedDepth")


def test_messages_say_by_their_encoding_what_they_hold() -> None:
    colour, depth, unknown = (
        ros.image(RGB, "bgr8"),
        ros.image(STEPS, "16UC1"),
        ros.image(RGB[..., 0], "bayer_rggb8"),
    )
    assert [(is_colour(one), is_depth(one)) for one in (colour, depth, unknown)] == [
        (True, False),
        (False, True),
        (False, False),
    ]
    assert is_depth(ros.compressed(b"", "32FC1; compressedDepth png"))
    assert is_colour(ros.compressed(b"", "jpeg"))


# CameraInfo


def of(message: object, pictures: str = "/cam/image_raw", size_px: tuple[int, int] = (8, 6)) -> InfoOf:
    return InfoOf(message=message, topic=info_topic(pictures), pictures=pictures, size_px=size_px)


@pytest.mark.parametrize("suffix", ["", "/compressed", "/compressedDepth"])
def test_the_calibration_is_beside_the_pictures(suffix: str) -> None:
    assert info_topic(f"/cam/image_raw{suffix}") == "/cam/camera_info"


@pytest.mark.parametrize(
    ("topic", "rectified"),
    [
        ("/camera/infra1/image_rect_raw", True),
        ("/zed/zed_node/rgb/color/rect/image/compressed", True),
        ("/zed/zed_node/rgb/image_rect_color", True),
        ("/camera/camera/color/image_raw", False),
        ("/corrected/image", False),
        ("/rect/camera/image_raw", False),
    ],
)
def test_rectified_topics_are_known_by_name(topic: str, rectified: bool) -> None:
    assert is_rectified(topic) == rectified


@pytest.mark.parametrize(
    ("model", "d"),
    [("plumb_bob", (0.1, -0.2, 0.001, 0.002, 0.3)), ("rational_polynomial", tuple(0.01 * n for n in range(1, 9)))],
)
def test_raw_pictures_have_k_and_the_distortion(model: str, d: tuple[float, ...]) -> None:
    found = calibration_of(of(ros.info(CAMERA, model=model, d=d, P=[9.0] * 12)), T)
    assert (found.fx_px, found.fy_px, found.cx_px, found.cy_px) == (10.0, 10.0, 3.5, 2.5)
    assert found.distortion is not None
    np.testing.assert_allclose(found.distortion, d, rtol=1e-6)
    assert found.T_world_camera is T


@pytest.mark.parametrize(("model", "d"), [("", ()), ("", (0.0,) * 5), ("plumb_bob", ())])
def test_a_lens_without_distortion_has_none(model: str, d: tuple[float, ...]) -> None:
    assert calibration_of(of(ros.info(CAMERA, model=model, d=d)), T).distortion is None


@pytest.mark.parametrize(("model", "d"), [("equidistant", (0.0,) * 4), ("", (0.1,) * 5), ("plumb_bob", (0.1,) * 8)])
def test_other_lenses_are_refused_by_name(model: str, d: tuple[float, ...]) -> None:
    with pytest.raises(HardwareError, match=f"distortion '{model}' of {len(d)} numbers; taken are plumb_bob"):
        calibration_of(of(ros.info(CAMERA, model=model, d=d)), T)


def test_rectified_pictures_have_p_and_no_distortion() -> None:
    P = (12.0, 0.0, 3.0, 0.0, 0.0, 12.0, 2.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    found = calibration_of(of(ros.info(CAMERA, d=(0.1,) * 5, P=P), "/cam/image_rect"), T)
    assert (found.fx_px, found.cx_px, found.cy_px, found.distortion) == (12.0, 3.0, 2.0, None)


@pytest.mark.parametrize("pictures", ["/cam/image_raw", "/cam/image_rect"])
def test_a_camera_that_is_not_calibrated_is_named(pictures: str) -> None:
    message = ros.info(CAMERA, K=[0.0] * 9, P=[0.0] * 12)
    with pytest.raises(HardwareError, match=r"the camera is not calibrated in ROS: . of /cam/camera_info is all 0"):
        calibration_of(of(message, pictures), T)


def test_optics_that_no_camera_has_are_refused() -> None:
    with pytest.raises(HardwareError, match=r"/cam/camera_info cannot be used: fx_px is 0\.01"):
        calibration_of(of(ros.info(CAMERA, K=(0.01, 0.0, 3.5, 0.0, 0.01, 2.5, 0.0, 0.0, 1.0))), T)
    with pytest.raises(HardwareError, match="without skew"):
        calibration_of(of(ros.info(CAMERA, K=(10.0, 3.0, 3.5, 0.0, 10.0, 2.5, 0.0, 0.0, 1.0))), T)


def test_a_calibration_of_another_size_is_refused() -> None:
    with pytest.raises(HardwareError, match="are 4 by 3 px, their calibration /cam/camera_info is for 8 by 6 px"):
        calibration_of(of(ros.info(CAMERA), size_px=(4, 3)), T)


def test_a_binned_part_of_the_sensor_sees_the_same_directions() -> None:
    part = calibration_of(of(ros.info(VIEW, binning=2, roi=(10, 4, 40, 30)), size_px=(20, 15)), T)
    # The centre of pixel (3, 5) of the part is the middle of pixels 16 and 17, 14 and 15 of the sensor.
    np.testing.assert_allclose(rays([[3.0, 5.0]], part), rays([[16.5, 14.5]], VIEW))


LEFT, RIGHT = ("/cam/left/image_rect", "/cam/right/image_rect")


def test_a_rectified_pair_has_the_baseline_of_p() -> None:
    found = pair_calibration_of(of(ros.info(CAMERA), LEFT), of(ros.info(CAMERA, shift_m=0.12), RIGHT), T)
    assert found.baseline_m == pytest.approx(0.12)
    assert found.raw_left is None


def test_exchanged_cameras_are_named() -> None:
    with pytest.raises(HardwareError, match="left and right are exchanged"):
        pair_calibration_of(of(ros.info(CAMERA, shift_m=0.12), LEFT), of(ros.info(CAMERA), RIGHT), T)


def test_a_pair_without_a_baseline_or_with_unequal_cameras_is_refused() -> None:
    with pytest.raises(HardwareError, match="has no baseline"):
        pair_calibration_of(of(ros.info(CAMERA), LEFT), of(ros.info(CAMERA), RIGHT), T)
    other = centred_camera(8, 6, 10.5, T)
    with pytest.raises(HardwareError, match="differ in P"):
        pair_calibration_of(of(ros.info(CAMERA), LEFT), of(ros.info(other, shift_m=0.1), RIGHT), T)
    with pytest.raises(HardwareError, match=r"one of .* is rectified"):
        pair_calibration_of(of(ros.info(CAMERA), LEFT), of(ros.info(CAMERA, shift_m=0.1), "/cam/right/image_raw"), T)
    with pytest.raises(HardwareError, match="both must have one size"):
        pair_calibration_of(of(ros.info(CAMERA), LEFT), of(ros.info(VIEW, shift_m=0.1), RIGHT, (64, 48)), T)


def test_a_raw_pair_is_rectified_by_r_and_its_lenses() -> None:
    R = rotation(pose((0.0, 0.0, 0.0), (0.999, 0.02, -0.03, 0.01)))
    d = (0.1, 0.0, 0.0, 0.0, 0.0)
    K = (11.0, 0.0, 3.0, 0.0, 11.0, 2.0, 0.0, 0.0, 1.0)
    left = of(ros.info(CAMERA, R=R, d=d, K=K), "/l/image_raw")
    right = of(ros.info(CAMERA, R=R.T, K=K, shift_m=0.1), "/r/image_raw")
    found = pair_calibration_of(left, right, T)
    assert found.fx_px == 10.0  # of P
    assert found.raw_left is not None
    assert found.raw_right is not None
    assert found.raw_left.fx_px == 11.0  # of K
    np.testing.assert_allclose(rotation(pose((0.0, 0.0, 0.0), found.raw_left.wxyz)), R, atol=1e-9)
    np.testing.assert_allclose(found.raw_left.distortion, d, rtol=1e-6)
    np.testing.assert_array_equal(found.raw_right.distortion, np.zeros(5))


def test_an_r_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(HardwareError, match="no rotation"):
        pair_calibration_of(
            of(ros.info(CAMERA, R=np.zeros((3, 3))), "/l/image_raw"),
            of(ros.info(CAMERA, shift_m=0.1), "/r/image_raw"),
            T,
        )


# Clouds

COLOURS = RNG.integers(0, 255, (48, 64, 3), dtype=np.uint8)


def seen(camera: CameraCalibration = VIEW, rough_m: float = 0.1) -> NDArray[np.float32]:
    """Points (height, width, 3) [m] that a camera sees, in its frame."""
    height, width = camera.height_px, camera.width_px
    depth = 0.8 + rough_m * np.random.default_rng(1).random((height, width))
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    at_origin = centred_camera(width, height, camera.fx_px, ORIGIN)
    return back_project(pixels, depth.ravel(), at_origin).reshape(height, width, 3).astype(np.float32)


def along_x(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Points of a camera in a frame with x forward, y left, z up."""
    return np.stack([points[..., 2], -points[..., 0], -points[..., 1]], axis=-1)


@pytest.mark.parametrize("separate", [False, True])
@pytest.mark.parametrize("big", [False, True])
def test_an_organised_cloud_is_its_picture(separate: bool, big: bool) -> None:
    points = seen()
    points[3, 4] = np.nan
    found = picture_of(ros.cloud(points, COLOURS, separate=separate, big=big), None, T, 5, "/p")
    np.testing.assert_array_equal(found.pixels, COLOURS)
    assert found.depth_m[3, 4] == 0.0
    np.testing.assert_array_equal(found.depth_m[4:], points[4:, :, 2])
    fitted = found.calibration
    assert (fitted.fx_px, fitted.cx_px, fitted.cy_px) == pytest.approx((60.0, 31.5, 23.5), abs=1e-3)
    assert found.stamp_ns == 5


def test_given_optics_count() -> None:
    found = picture_of(ros.cloud(seen(), COLOURS), (61.0, 61.0, 31.0, 23.0), T, 0, "/p")
    assert found.calibration.fx_px == 61.0


@pytest.mark.parametrize("organised", [True, False])
def test_a_frame_that_looks_along_x_is_turned(organised: bool) -> None:
    points = along_x(seen())
    colours = COLOURS
    if not organised:
        points, colours = points.reshape(1, -1, 3), colours.reshape(1, -1, 3)
    message = ros.cloud(points, colours, frame="zed_left_camera_frame")
    turned = camera_in_frame(message, "/p")
    np.testing.assert_allclose(rotation(turned) @ [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(rotation(turned) @ [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], atol=1e-12)
    found = picture_of(message, None, turned, 0, "/p")
    rows, columns = np.nonzero(found.depth_m)
    shown = back_project(np.column_stack([columns, rows]), found.depth_m[rows, columns], found.calibration)
    # Half a pixel of the drawn picture is 10 mm at 0.9 m.
    assert KDTree(along_x(seen()).reshape(-1, 3)).query(shown)[0].max() < 0.02


def test_a_cloud_that_is_not_a_picture_is_refused() -> None:
    shuffled = RNG.permutation(seen().reshape(-1, 3)).reshape(48, 64, 3)
    with pytest.raises(HardwareError, match=r"not the picture of a pinhole camera: points are .* beside their pixels"):
        picture_of(ros.cloud(shuffled, COLOURS), None, T, 0, "/p")


def test_a_cloud_of_another_frame_than_its_camera_s_is_refused() -> None:
    around = (RNG.random((1, 5000, 3)) - 0.5).astype(np.float32)
    with pytest.raises(HardwareError, match="not seen from its frame 'base_link'"):
        picture_of(ros.cloud(around, around.astype(np.uint8), frame="base_link"), None, T, 0, "/p")


def test_clouds_without_colours_points_or_bytes_are_refused() -> None:
    with pytest.raises(HardwareError, match="has no colours; needed is a field rgb or rgba"):
        picture_of(ros.cloud(seen(), None), None, T, 0, "/p")
    with pytest.raises(HardwareError, match="0 points in front of its camera"):
        picture_of(ros.cloud(np.full((1, 500, 3), np.nan, dtype=np.float32), COLOURS[:1, :1]), None, T, 0, "/p")
    short = ros.cloud(seen(), COLOURS)
    short.data = short.data[:-1]
    with pytest.raises(HardwareError, match="damaged or empty"):
        picture_of(short, None, T, 0, "/p")
    outside = ros.cloud(seen(), COLOURS)
    outside.fields[0].offset = 30
    with pytest.raises(HardwareError, match="damaged or empty"):
        picture_of(outside, None, T, 0, "/p")
    without = ros.cloud(seen(), COLOURS)
    without.fields[2].name = "intensity"
    with pytest.raises(HardwareError, match=r"fields x, y, intensity, rgb; x, y and z are needed"):
        picture_of(without, None, T, 0, "/p")


@pytest.mark.parametrize("focal_px", [40.0, 60.0, 400.0])
@pytest.mark.parametrize("kept", [1.0, 0.9])
def test_a_cloud_without_order_is_drawn_without_holes_and_without_loss(focal_px: float, kept: float) -> None:
    camera = centred_camera(320, 240, focal_px * 5.0, T)
    points = seen(camera).reshape(-1, 3)
    order = np.random.default_rng(3).permutation(len(points))[: int(kept * len(points))]
    colours = np.random.default_rng(4).integers(1, 255, (len(points), 3), dtype=np.uint8)
    found = picture_of(ros.cloud(points[order][None], colours[order][None]), None, T, 0, "/p")
    taken = found.depth_m > 0.0
    # A finer picture would have holes, a coarser one would lose points: at least half of the camera's resolution.
    assert taken.mean() > 0.9 * kept
    assert 0.5 * camera.fx_px < found.calibration.fx_px <= 1.2 * camera.fx_px
    # Each pixel shows a point of the cloud, where it is, with its own colour.
    rows, columns = np.nonzero(taken)
    by_colour = {tuple(colour): point for colour, point in zip(colours.tolist(), points, strict=True)}
    for row, column in zip(rows[::997], columns[::997], strict=True):
        x, y, z = by_colour[tuple(found.pixels[row, column].tolist())]
        assert found.depth_m[row, column] == z
        assert found.calibration.fx_px * x / z + found.calibration.cx_px == pytest.approx(column, abs=0.51)
        assert found.calibration.fy_px * y / z + found.calibration.cy_px == pytest.approx(row, abs=0.51)


def test_of_two_points_in_a_pixel_the_nearest_is_drawn() -> None:
    near = seen()
    both = np.concatenate([near * np.float32(2.0), near]).reshape(1, -1, 3)
    colours = np.concatenate([np.zeros_like(COLOURS), np.maximum(COLOURS, 1)]).reshape(1, -1, 3)
    found = picture_of(ros.cloud(both, colours), None, T, 0, "/p")
    taken = found.depth_m > 0.0
    assert (found.pixels[taken].max(axis=1) > 0).all()
    assert found.depth_m.max() <= near[..., 2].max()
