"""`dlokit calibrate box`: the table's plane and the workspace, chosen in the viewer in the camera's live cloud."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import tomli_w
import tyro
from rich.console import Console
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.app.commands import CliCommand, flag, value_of
from dlokit.app.console import say
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import HardwareError, InputError, NoMorePictures, SkillFailure
from dlokit.extras.calibration.box_page import BoxPage, ChosenBox
from dlokit.extras.calibration.cell_pictures import cell_config, pictures_of_board_on_table
from dlokit.extras.calibration.plane_fit import PlaneFit, fit_plane
from dlokit.extras.calibration.scene_cloud import SceneCloud, scene_cloud
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.calibration_file import check_has_pose, read_calibration
from dlokit.functional.cameras.corrected import CalibratedCamera
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.functional.cameras.strategies import CAMERAS, AnyCamera
from dlokit.functional.cell.rendering import check_opengl
from dlokit.skills.viewer.serving.page import LoopGate
from dlokit.system.results.run_folder import run_folder
from dlokit.types.image import CameraPictures

LINES = "installation.toml"
_HOST = "127.0.0.1"
_TIMEOUT_S = 2.0
_AGAIN_S = 1.0
_PERIOD_S = 0.5
"""Time between two clouds [s]: nothing moves while a person sets up a cell."""
_BEGIN = ChosenBox(frame=geometry.pose((0.0, 0.0, 0.0)), lower_m=(0.3, -0.3, -0.05), upper_m=(0.7, 0.3, 0.3))
"""The box before it is dragged: where the table of the default cell is."""
_DIGITS = 4  # of lengths and angles in the file: a tenth of a millimetre


@dataclass(frozen=True, kw_only=True)
class BoxArgs:
    """Choose the plane of the table and the workspace of the arm in the viewer, in the camera's live cloud.

    The page shows what the camera sees and a box with two corners to drag. With bare table in the box, a robust fit
    finds its plane; then the corners are dragged to the space that the tool may use. The result is the lines [table]
    and [[arms]] of an installation file, in the frame of the camera's pose, printed and written.

    Try
      dlokit calibrate box                                  the simulated camera's picture of its cell
      dlokit calibrate box --camera realsense --calibration calibration.toml
      dlokit shape --installation runs/<time>-calibrate-box/installation.toml

    Exit code: 0 after the lines have been written; 2 bad input; 130 after Ctrl-C.
    """

    camera: Annotated[str, tyro.conf.arg(constructor_factory=CAMERAS.names)] = SimulatedStereoConfig.name
    """The camera: simulated, realsense, genicam, recorded, or another installed one."""
    calibration: Annotated[Path | None, flag("FILE", "the simulated camera's own")] = None
    """Calibration of the camera with its pose, of `dlokit calibrate handeye`."""
    seed: int = 0
    """Seed of the simulated cell."""
    port: int = 8080
    """TCP port of the page; 0 takes any free one."""
    out: Annotated[Path | None, flag("DIR", "runs/<time>-calibrate-box/")] = None
    """Folder for installation.toml; it must be empty or new."""
    camera_settings: Annotated[AnyCamera, tyro.conf.arg(name="camera")] = field(default_factory=SimulatedStereoConfig)
    """Settings of the camera."""


def _defaults(arguments: Sequence[str]) -> BoxArgs:
    """The settings of the camera that the command line names."""
    name = value_of(arguments, "--camera")
    return BoxArgs() if name is None else BoxArgs(camera_settings=CAMERAS.named(name, "--camera")())


def run(args: BoxArgs) -> int:
    """Show the page until the lines are written."""
    console = Console()
    source = _source(args)
    folder = run_folder(args.out, "calibrate-box")
    chosen = asyncio.run(Choosing(source, console, args.port).chosen())
    lines = chosen.lines(args.calibration)
    (folder / LINES).write_text(lines, encoding="utf-8")
    say(console, lines)
    say(console, f"written: {folder / LINES}")
    return 0


def _source(args: BoxArgs) -> "Camera | CameraPictures":
    """The camera, or one picture of the simulated cell, in which nothing moves."""
    known = None if args.calibration is None else read_calibration(args.calibration)
    if known is not None:
        check_has_pose(str(args.calibration), known)
    settings = args.camera_settings
    if not settings.sees_cell:
        camera = settings.build(MemoryTransport())
        return camera if known is None else CalibratedCamera(camera, known, str(args.calibration))
    if not isinstance(settings, SimulatedStereoConfig):
        raise InputError(f"--camera {args.camera} sees the simulated cell; use --camera simulated to show it.")
    check_opengl()
    config = cell_config(args.seed, held=False, lens_distortion=False)
    config = replace(config, cell=replace(config.cell, board=None))
    images = pictures_of_board_on_table(config, 1, lambda number, count: None)[0].images
    return images if known is None else msgspec.structs.replace(images, calibration=known)


@dataclass(frozen=True, kw_only=True, eq=False)
class ChosenPlaces:
    """The choices of a person."""

    plane: PlaneFit | None
    """None: the table is at z = 0 of the frame."""
    box: ChosenBox

    def lines(self, calibration: Path | None) -> str:
        """The lines of an installation file."""
        parts: dict[str, Any] = {}
        if self.plane is not None:
            T = self.plane.frame
            turns = Rotation.from_quat(T.wxyz, scalar_first=True).as_euler("xyz", degrees=True)
            parts["table"] = {"position_m": _rounded(T.position_m), "rpy_deg": _rounded(turns)}
        parts["arms"] = [{"workspace": {"lower_m": _rounded(self.box.lower_m), "upper_m": _rounded(self.box.upper_m)}}]
        if calibration is not None:
            parts["camera"] = {"calibration": str(calibration.absolute())}
        return tomli_w.dumps(parts)


def _rounded(values: Any) -> list[float]:
    return [round(float(value), _DIGITS) + 0.0 for value in np.asarray(values)]


class Choosing:
    """The page, its live cloud, and the actions of its buttons."""

    def __init__(self, source: Camera | CameraPictures, console: Console, port: int) -> None:
        self._source = source
        self._console = console
        self._port = port
        self._cloud: SceneCloud | None = None
        self._plane: PlaneFit | None = None
        self._page: BoxPage | None = None
        self._written = asyncio.Event()

    async def chosen(self) -> ChosenPlaces:
        """Serve the page until a person has pressed the second button. Raises `MachineError`, `HardwareError`."""
        gate = LoopGate(asyncio.get_running_loop())
        self._page = page = BoxPage(_HOST, self._port, _BEGIN, gate, on_fit=self.fit, on_write=self.write)
        say(self._console, f"viewer: {page.url}")
        looking = asyncio.create_task(self._look(page))
        waiting = asyncio.create_task(self._written.wait())
        try:
            await asyncio.wait({looking, waiting}, return_when=asyncio.FIRST_COMPLETED)
            if looking.done():
                looking.result()
            await waiting
        finally:
            looking.cancel()
            waiting.cancel()
            gate.shut()
            page.close()
        return ChosenPlaces(plane=self._plane, box=page.box)

    @property
    def shown(self) -> bool:
        """Whether the page shows a cloud."""
        return self._cloud is not None

    @property
    def box(self) -> ChosenBox:
        """The present box."""
        return _BEGIN if self._page is None else self._page.box

    def fit(self) -> None:
        """Fit the table to the points in the box, and show the residual."""
        page, cloud = self._page, self._cloud
        if page is None or cloud is None:
            return
        try:
            plane = fit_plane(page.box.holds(cloud.points_world))
        except SkillFailure as failure:
            page.say(f"**No plane:** {failure.detail}")
            return
        self._plane = plane
        page.show_table(plane.frame)
        page.say(
            f"The table is {plane.frame.position_m[2] * 1e3:+.1f} mm from z = 0 at the origin and inclined by "
            f"{np.degrees(plane.tilt_rad):.2f}°; {plane.points} points are {plane.rms_m * 1e3:.1f} mm off it (RMS). "
            "The box is now in the frame of the table."
        )

    def write(self) -> None:
        """End with the present choices."""
        self._written.set()

    async def _look(self, page: BoxPage) -> None:
        """Show clouds until cancelled; the last cloud of the cell or of a recording stays."""
        if isinstance(self._source, CameraPictures):
            await self._show(page, self._source)
            return
        with self._source as camera:
            while True:
                try:
                    pictures = await camera.capture(_TIMEOUT_S)
                except NoMorePictures:
                    return
                except HardwareError as error:
                    page.say(f"**The camera is lost:** {error}")
                    await asyncio.sleep(_AGAIN_S)
                    continue
                await self._show(page, pictures)
                await asyncio.sleep(_PERIOD_S)

    async def _show(self, page: BoxPage, pictures: CameraPictures) -> None:
        self._cloud = await asyncio.to_thread(scene_cloud, pictures)
        page.show_cloud(self._cloud.points_world, self._cloud.colours)


COMMAND = CliCommand(BoxArgs, run, _defaults)
