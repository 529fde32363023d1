"""`dlokit calibrate table`: height and tilt of the table, from a board on it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from rich.console import Console

from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.description.shapes import CENTRE_M
from dlokit.errors import EXIT_OTHERWISE, SkillFailure
from dlokit.extras.calibration.board_table import table_plane
from dlokit.extras.calibration.commands.common import (
    BoardArgs,
    given_calibration,
    input_error,
    keep_pictures,
    seen_on_table,
)
from dlokit.extras.calibration.commands.folder import CALIBRATION
from dlokit.functional.cameras.calibration_file import (
    CalibrationResidual,
    MeasuredLatency,
    MeasuredTable,
    check_same_camera,
    read_part,
    write_calibration,
)

LARGEST_HEIGHT_M = 0.003
"""Above this the fingers touch the table, or close over the DLO [m]: they grasp 2 mm above it."""
LARGEST_TILT_DEG = 0.5
"""Above this the height differs by 3 mm over the workspace [°]."""


@dataclass(frozen=True, kw_only=True)
class TableArgs(BoardArgs):
    """Measure height and tilt of the table in the arm's world, from a ChArUco board that lies on it.

    In dlokit the table's top is z = 0. Perception corrects the camera's pose by the table, but the arm moves in its own
    world frame: if the table is higher, lower or tilted in that frame, shim the table or the base of the arm.

    Try
      dlokit calibrate table                                  in the simulated cell
      dlokit calibrate table --calibration runs/<time>-calibrate-handeye/calibration.toml --from pictures

    Writes calibration.toml, the same calibration with the measured table.
    Exit code: 0; 3 when the table is off by more than dlokit tolerates; 2 bad input.
    """

    calibration: Annotated[Path | None, flag("FILE", "the simulated camera's own")] = None
    """Calibration of the camera with its pose, of `dlokit calibrate handeye` with the same board."""
    thickness_m: float = 0.004
    """Thickness of the board [m]; that of the simulated one is 4 mm."""


def run(args: TableArgs) -> int:
    """Take or read the pictures, measure, print and write."""
    console = Console()
    calibration = given_calibration(args, args.calibration)
    residual = read_part(args.calibration, CalibrationResidual)
    folder = args.folder_for("calibrate-table")
    seen = seen_on_table(args, console)
    keep_pictures(args, folder, seen)
    if calibration is not None:
        check_same_camera(str(args.calibration), calibration, seen.given)
    camera = seen.given if calibration is None else args.installed.read(calibration)
    try:
        plane = table_plane(
            seen.shots,
            args.board,
            camera,
            print_scale=1.0 if residual is None else residual.print_scale or 1.0,
            thickness_m=args.thickness_m,
            at_m=CENTRE_M,
        )
    except SkillFailure as failure:
        raise input_error(failure) from failure
    table = MeasuredTable(
        height_m=plane.height_m,
        tilt_x_deg=float(np.degrees(plane.tilt_x_rad)),
        tilt_y_deg=float(np.degrees(plane.tilt_y_rad)),
        residual_m=plane.residual_m,
    )
    say(
        console,
        f"the table is at {table.height_m * 1e3:+.2f} mm in the middle of the workspace, tilted by "
        f"{table.tilt_x_deg:+.2f}° about x and {table.tilt_y_deg:+.2f}° about y; corners of the board are "
        f"{table.residual_m * 1e3:.2f} mm off the plane",
    )
    latency = read_part(args.calibration, MeasuredLatency)
    write_calibration(folder / CALIBRATION, args.installed.written(camera), residual, table, latency)
    say(console, f"written: {folder / CALIBRATION}")
    return _judged(table, console)


def _judged(table: MeasuredTable, console: Console) -> int:
    tilt_deg = float(np.hypot(table.tilt_x_deg, table.tilt_y_deg))
    if abs(table.height_m) <= LARGEST_HEIGHT_M and tilt_deg <= LARGEST_TILT_DEG:
        return 0
    say(
        console,
        f"up to {LARGEST_HEIGHT_M * 1e3:.0f} mm and {LARGEST_TILT_DEG:g}° are fine: shim the table or the base of the "
        "arm, or calibrate the camera again if the board did lie flat",
    )
    return EXIT_OTHERWISE


COMMAND = CliCommand(TableArgs, run)
