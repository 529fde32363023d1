"""Pictures of the scene for the cell's cameras: noise, believed pose, clock; the stereo camera; a person's view."""

import os
import sys
import threading
from collections.abc import Iterable
from typing import Any

import cv2
import msgspec
import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.mounts import ArmMount
from dlokit.description.default_cameras import default_calibration
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.errors import DlokitError, MachineError
from dlokit.functional.cameras.device_clock import DeviceClock
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.lens import separate_cameras, through_lens, with_lenses
from dlokit.geometry.camera import SIDES, camera_alone, centred_camera
from dlokit.types.arrays import Float32Array, UInt8Array
from dlokit.types.image import CameraCalibration, StereoImages
from dlokit.types.pose import Pose

CAMERAS = ("stereo_left", "stereo_right")
_NOISE_COUNT = 1 << 21
_FLIP_YZ = np.diag([1.0, -1.0, -1.0])  # OpenGL cameras look along -z, with y up
_AMBIENT = 0.35  # light from everywhere
_PIXEL_M = 1e-5  # size of a sensor's pixel; only ratios matter
_NEAREST_M = 0.1
FARTHEST_M = 6.0
"""Far clipping plane of the renderer [m]."""


class Rig:
    """Cameras of the cell; their OpenGL context is made with the first picture, by the thread that takes it."""

    def __init__(self, width_px: int, height_px: int, *, shadows: bool) -> None:
        """The size of the pictures [px], and whether the arms cast shadows."""
        self._size, self._shadows = (width_px, height_px), shadows
        self._renderer: PictureRenderer | None = None

    def _renderer_for(self, model: Any) -> "PictureRenderer":
        if self._renderer is None:
            self._renderer = PictureRenderer(model, *self._size, shadows=self._shadows)
        return self._renderer

    def close(self) -> None:
        """Release the OpenGL context."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class StereoRig(Rig):
    """Both cameras. Their true pose and the believed one differ by a small error drawn from the seed."""

    def __init__(self, config: CellConfig, *, seed: int, installation: Installation = PAPERS_CELL) -> None:
        super().__init__(config.width_px, config.height_px, shadows=config.shadows)
        rng = np.random.default_rng([seed, 0xCA])
        self.true_calibration = cell_camera(config, installation)
        self._taking = [camera_alone(self.true_calibration, side) for side in SIDES]
        self.calibration = disturbed(self.true_calibration, config, rng)
        self._noise = PictureNoise(config.image_noise_sigma, config.width_px, config.height_px, rng)

    def capture(self, model: Any, data: Any, stamp_ns: int) -> StereoImages:
        """Both pictures of the present moment; poses in `data` must be up to date."""
        renderer = self._renderer_for(model)
        left, right = (
            self._noise.added_to(through_lens(renderer.render(data, name), camera, camera.distortion))
            for name, camera in zip(CAMERAS, self._taking, strict=True)
        )
        return StereoImages(stamp_ns=stamp_ns, frame="camera", left=left, right=right, calibration=self.calibration)

    def view(self, model: Any, data: Any) -> UInt8Array:
        """The first camera's picture (height, width, 3) without noise and lens, for display.

        It draws no noise, so that later pictures do not depend on it.
        """
        return self._renderer_for(model).render(data, CAMERAS[0])


class PictureNoise:
    """Noise of a camera's pixels."""

    def __init__(self, sigma: float, width_px: int, height_px: int, rng: np.random.Generator) -> None:
        """`sigma` is the standard deviation of each pixel [grey levels of 255]."""
        self._sigma = sigma
        self._noise = rng.normal(0.0, sigma, _NOISE_COUNT + 3 * width_px * height_px).round().astype(np.int16)
        self._rng = rng

    def added_to(self, picture: UInt8Array) -> UInt8Array:
        """A picture (height, width, 3) with noise."""
        if self._sigma == 0.0:
            return picture
        # A random stretch of noise drawn beforehand: fresh normals would cost as much as the rendering.
        start = int(self._rng.integers(0, _NOISE_COUNT))
        noise = self._noise[start : start + picture.size].reshape(picture.shape)
        return np.asarray(cv2.add(picture, noise, dtype=cv2.CV_8U), dtype=np.uint8)


def cell_camera(config: CellConfig, installation: Installation = PAPERS_CELL) -> CameraCalibration:
    """The true calibration of the cell's camera, with its serial number and picture size."""
    ideal = installed(default_calibration(config.width_px, config.height_px), installation)
    if config.separate_cameras:
        return separate_cameras(ideal)
    return with_lenses(ideal) if config.lens_distortion else ideal


def installed(camera: CameraCalibration, installation: Installation) -> CameraCalibration:
    """Convert a camera's pose from the installation's frame to the world."""
    return msgspec.structs.replace(camera, T_world_camera=installation.camera_in_world(camera.T_world_camera))


def add_camera(spec: Any, name: str, calibration: CameraCalibration) -> None:
    """Add a camera to `spec` (MjSpec)."""
    T = calibration.T_world_camera
    turned = geometry.homogeneous(geometry.rotation(T) @ _FLIP_YZ, np.zeros(3))
    width, height = calibration.width_px, calibration.height_px
    camera = spec.worldbody.add_camera(name=name, pos=T.position_m)
    camera.quat = geometry.pose_from_matrix(turned).wxyz
    camera.resolution = [width, height]
    camera.sensor_size = [width * _PIXEL_M, height * _PIXEL_M]
    camera.focal_pixel = [calibration.fx_px, calibration.fy_px]
    # Ours counts from the centre of the first pixel, OpenGL from its corner.
    camera.principal_pixel = [width / 2 - (calibration.cx_px + 0.5), height / 2 - (calibration.cy_px + 0.5)]


def add_stereo_cameras(spec: Any, calibration: CameraCalibration) -> None:
    """Add the two cameras of a stereo calibration to `spec` (MjSpec)."""
    for name, side in zip(CAMERAS, SIDES, strict=True):
        add_camera(spec, name, camera_alone(calibration, side))


def set_picture_quality(spec: Any, sizes_px: Iterable[tuple[int, int]], *, shadows: bool, light: float) -> None:
    """Configure the rendering of `spec` (MjSpec); `sizes_px` are the width and height of each camera.

    `light` is a factor on the ambient light.
    """
    visual = spec.visual
    widths, heights = zip(*sizes_px, strict=True)
    visual.global_.offwidth, visual.global_.offheight = max(widths), max(heights)
    visual.quality.offsamples = 0  # with 4 samples a pixel software rendering takes two to four times as long
    visual.quality.shadowsize = 2048 if shadows else 0
    visual.headlight.ambient = [_AMBIENT * light] * 3
    visual.headlight.diffuse, visual.headlight.specular = [0.0] * 3, [0.0] * 3
    # Clipping planes are multiples of the model's extent, which is fixed here so that they are in metres.
    spec.stat.extent = 1.0
    visual.map.znear, visual.map.zfar = _NEAREST_M, FARTHEST_M


def disturbed(true: CameraCalibration, config: CellConfig, rng: np.random.Generator) -> CameraCalibration:
    """The believed calibration: off by exactly the configured distance and angle, in random directions."""
    believed = displaced(true.T_world_camera, config.camera_error_m, config.camera_error_deg, rng)
    return msgspec.structs.replace(true, T_world_camera=believed)


def displaced(T: Pose, distance_m: float, angle_deg: float, rng: np.random.Generator) -> Pose:
    """A pose that is off by exactly a distance [m] and an angle [°], in random directions."""
    shift, axis = rng.normal(size=3), rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * np.radians(angle_deg))
    error = geometry.homogeneous(turn.as_matrix(), shift / np.linalg.norm(shift) * distance_m)
    return geometry.pose_from_matrix(geometry.matrix(T) @ error)


class PictureRenderer:
    """One OpenGL context, owned by the thread that made it."""

    def __init__(self, model: Any, width_px: int, height_px: int, *, shadows: bool) -> None:
        self._thread = threading.get_ident()
        self._gl = _gl_context(width_px, height_px)
        self._gl.make_current()
        self._model = model
        self._scene: Any = mujoco.MjvScene(model, maxgeom=500)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = False
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = False
        self._context: Any = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR  # the finer one: in float32, 0 is exact
        self._rectangle: Any = mujoco.MjrRect(0, 0, width_px, height_px)
        self._option: Any = mujoco.MjvOption()
        self._option.geomgroup[:] = (1, 0, 1, 0, 0, 0)
        self._buffer = np.empty((height_px, width_px, 3), dtype=np.uint8)
        self._depth = np.empty((height_px, width_px), dtype=np.float32)

    def render(self, data: Any, camera: str) -> UInt8Array:
        """One picture (height, width, 3)."""
        self._draw(data, camera)
        mujoco.mjr_readPixels(self._buffer, None, self._rectangle, self._context)
        return np.ascontiguousarray(self._buffer[::-1])

    def depth_m(self, data: Any, camera: str) -> Float32Array:
        """Depth of each pixel (height, width) along z of the camera [m]; `FARTHEST_M` where nothing is drawn."""
        self._draw(data, camera)
        mujoco.mjr_readPixels(None, self._depth, self._rectangle, self._context)
        # MuJoCo's buffer is 1 at the near clipping plane and 0 at the far one, and linear in the inverse depth.
        inverse = 1.0 / FARTHEST_M + self._depth[::-1].astype(np.float64) * (1.0 / _NEAREST_M - 1.0 / FARTHEST_M)
        return (1.0 / inverse).astype(np.float32)

    def _draw(self, data: Any, camera: str) -> None:
        if threading.get_ident() != self._thread:
            raise DlokitError("The cell renders on the thread that took its first picture; call it from there alone.")
        self._gl.make_current()
        view: Any = mujoco.MjvCamera()
        view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        view.fixedcamid = self._model.camera(camera).id
        mujoco.mjv_updateScene(self._model, data, self._option, None, view, mujoco.mjtCatBit.mjCAT_ALL, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._context)

    def close(self) -> None:
        """Free the context."""
        self._gl.make_current()
        self._context.free()
        self._gl.free()


def check_opengl() -> None:
    """Raise `MachineError` when this machine cannot render the cell's pictures."""
    context = _gl_context(64, 64)
    context.make_current()
    context.free()


_rendering_processes: set[int] = set()
"""Processes that have made an OpenGL context: a forked process inherits the entry of its parent."""


def check_not_forked() -> None:
    """Raise `MachineError` in a process that was forked from one with OpenGL: its first picture would never arrive.

    The forked process lacks the threads that draw.
    """
    if _rendering_processes - {os.getpid()}:
        raise MachineError(
            "This process was forked from one that has taken pictures of a cell, which OpenGL does not survive. Start "
            "it as a new one: multiprocessing.get_context('spawn'), or "
            "gymnasium.make_vec(..., vector_kwargs={'context': 'spawn'})."
        )


def _gl_context(width: int, height: int) -> Any:
    """An OpenGL context without a window. Raises `MachineError` when this machine has none."""
    check_not_forked()
    _rendering_processes.add(os.getpid())
    try:
        if sys.platform == "linux":
            from mujoco.egl import GLContext
        else:
            from mujoco.gl_context import GLContext
        return GLContext(width, height)
    except Exception as error:  # every back end has its own errors; all mean the same
        raise MachineError(
            f"No OpenGL for the cell's cameras ({type(error).__name__}: {error}). `dlokit doctor` prints the command "
            "that installs software rendering on Linux."
        ) from error


_SWITCHED_ON_NS = 7_000_000_000
"""Reading of the device's clock at the beginning of the cell's time [ns]."""


class CameraClock:
    """Stamps pictures by a clock that drifts and may jump, converted to the cell's time by the pictures' arrival.

    The driver of a real camera does the same. It cannot measure the smallest latency of its pictures: its stamps are
    late by this time until `dlokit calibrate latency` has measured it.
    """

    def __init__(self, drift_ppm: float) -> None:
        """`drift_ppm`: microseconds per second by which the device's clock is fast."""
        self._drift = 1e-6 * drift_ppm
        self._ahead_ns = _SWITCHED_ON_NS
        self._clock = DeviceClock(least_latency_ns=0)

    def stamped(self, exposed_ns: int, arrived_ns: int) -> int:
        """The stamp of a picture [ns] that was exposed and that arrived at these times of the cell.

        Raises `ClockJumped` at the first picture after a jump.
        """
        device_ns = exposed_ns + round(exposed_ns * self._drift) + self._ahead_ns
        return device_ns + self._clock.arrived(device_ns, arrived_ns).offset_ns

    def jump(self, by_ns: int) -> None:
        """Set the device's clock forward [ns]. For tests and benches: no skill does it."""
        self._ahead_ns += by_ns


VIEWPOINT = "viewpoint"
ABOVE_TABLE_M = 0.15
"""Height above the middle of the table of the point that the camera looks at [m], so that the arm is in view too."""
DISTANCE_M = 1.65
"""Distance from the camera to that point [m]: the picture shows the usable table and an arm at its edge."""
ELEVATION_DEG = 38.0
TURN_DEG = 45.0
"""Angle of the camera about the vertical from the arm's forward axis, so that the fingers hide less of the DLO."""
FOCAL_PER_WIDTH = 1.1
"""Focal length over the width of the picture: 49° across."""


def viewpoint_camera(width_px: int, height_px: int, installation: Installation, arm: ArmMount) -> CameraCalibration:
    """A camera at the viewpoint of a person across the table from an arm, a little to the side."""
    centre = np.array([*installation.table.centre_m, ABOVE_TABLE_M])
    reach = centre[:2] - np.array(arm.place_m)
    bearing_rad = float(np.arctan2(reach[1], reach[0])) + np.radians(TURN_DEG)
    elevation_rad = np.radians(ELEVATION_DEG)
    away = np.array([np.cos(bearing_rad), np.sin(bearing_rad), np.tan(elevation_rad)]) * np.cos(elevation_rad)
    T = geometry.homogeneous(geometry.looking_along(-away), centre + DISTANCE_M * away)
    camera = centred_camera(width_px, height_px, FOCAL_PER_WIDTH * width_px, geometry.pose_from_matrix(T))
    return msgspec.structs.replace(camera, serial=VIEWPOINT)


class ViewpointRig(Rig):
    """Renders a person's view of the cell, without noise and without a lens, for videos of a run."""

    def __init__(self, calibration: CameraCalibration, *, shadows: bool) -> None:
        super().__init__(calibration.width_px, calibration.height_px, shadows=shadows)

    def capture(self, model: Any, data: Any) -> UInt8Array:
        """A picture (height, width, 3) of the present moment; poses in `data` must be up to date."""
        return self._renderer_for(model).render(data, VIEWPOINT)
