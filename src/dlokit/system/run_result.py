"""`result.json`: what became of a run, in figures."""

import hashlib
import math
from pathlib import Path

import msgspec

from dlokit.errors import InputError
from dlokit.functional.cell.episode import Episode
from dlokit.system.goal_result import VerdictResult
from dlokit.types.flow import RunOutcome

FILE_NAME = "result.json"


class CorrectionResult(msgspec.Struct, frozen=True, kw_only=True):
    """One small motion of the tool while it held the DLO."""

    x_m: float
    """What the tool moved, in the world [m]."""
    y_m: float
    z_m: float
    yaw_rad: float
    """What it turned about the vertical [rad]."""
    before_m: float
    """The error that was to be expected had the DLO been let go before it [m]."""
    predicted_m: float
    """The error that was promised of it [m]."""
    seen_m: float | None = None
    """The error to be expected of letting go after it, by what was seen then [m]; None where nothing was seen."""


class ActionResult(msgspec.Struct, frozen=True, kw_only=True):
    """One action, one row of the history."""

    action: int
    """Number of the action, from 1."""
    kind: str
    """What the action did, in words: pick-and-place, drag, lay-down, …"""
    grasp_node: int
    grasp_ok: bool
    """Whether the gripper held the DLO."""
    slipped: bool = False
    """Whether the DLO slipped out of the gripper on the way."""
    rmse_m: float
    """Our own estimate of the error to the goal after the action [m]."""
    predicted_rmse_m: float | None = None
    """What was expected of it when it was chosen [m]; None where the planner predicts nothing."""
    missed_m: float | None = None
    """RMS distance of the shape after it to the one that was predicted [m]; None where nothing was."""
    true_rmse_m: float | None = None
    """The evaluator's, 2 s after the release [m]; None where there is no truth."""
    duration_s: float
    """From the choice of the grasp to the look after the release [s], on the cell's clock."""
    robot_time_s: float
    """From the choice of the grasp until the arm is out of the picture again [s], on the cell's clock."""
    path_length_m: float
    """What the tool travelled in that time [m]."""
    planning_time_s: float
    """Wall time spent choosing it [s]."""
    corrections: tuple[CorrectionResult, ...] = ()
    """What control did before the release."""
    control_end: str | None = None
    """Why control ended, by name; not_worth_it where it was not chosen; None where it was not asked for."""
    ended_by: str | None = None
    """What ended the action before its planned end: slipped, or the robot's reason (lease_lost, lost_commander,
    arms_too_near, …); None where nothing did."""


class CameraResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the look at the robot's own hand said of the camera's place."""

    text: str
    """For people."""
    offset_x_m: float | None = None
    """How far the camera was off its calibration along the table [m], and was corrected; None where it was not."""
    offset_y_m: float | None = None
    yaw_rad: float | None = None
    """How far it was turned about the vertical [rad]."""
    scatter_m: float | None = None
    """How far the pictures disagreed after the correction (root mean square) [m]."""


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """A run. The fields and their order are those of the file."""

    outcome: RunOutcome
    reason: str | None = None
    """What stood in the way, or who stopped the run; None when converged."""
    actions: int
    rmse_m: float | None
    """The last estimate of the error [m]; None only when the DLO was never seen."""
    start_rmse_m: float | None = None
    """The first estimate, before any action [m]; None when the run ended before it."""
    true_rmse_m: float | None = None
    """The evaluator's, 2 s after the last release [m]; None where there is no truth."""
    true_largest_m: float | None = None
    """Distance of the node that is farthest from its goal then [m]; None where there is no truth."""
    threshold_m: float
    seed: int
    sim_time_s: float
    """Time on the cell's clock [s]."""
    wall_time_s: float
    planning_time_s: float
    """Wall time spent choosing actions [s]."""
    history: tuple[ActionResult, ...] = ()
    config_hash: str
    version: str
    episode: Episode | None = None
    """What was drawn for the cell, which the system was not told; None when nothing is randomised."""
    goal_verdict: VerdictResult | None = None
    """What was said of the goal; None when the run ended before it was judged."""
    camera: CameraResult | None = None
    """What was said of the camera's place; None when it was not checked."""


def write_result(folder: Path, result: RunResult) -> Path:
    """Write `result.json` into a run's folder, whole or not at all. Raises `InputError` for NaN or infinity."""
    _refuse_non_finite(result)
    path = folder / FILE_NAME
    part = path.with_suffix(".json.part")
    part.write_bytes(msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n")
    part.replace(path)
    return path


def read_result(folder: Path) -> RunResult:
    """The result in a run's folder. Raises `InputError` when it is missing or is no result."""
    path = folder / FILE_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=RunResult)
    except FileNotFoundError:
        raise InputError(f"{folder} holds no {FILE_NAME}: give the folder of a run that has ended.") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path} is not the result of a run ({error}): run it again.") from error


def config_hash(config_toml: str) -> str:
    """Twelve hexadecimal digits that name a configuration: two runs with the same ones were set up alike."""
    return hashlib.sha256(config_toml.encode()).hexdigest()[:12]


def _refuse_non_finite(result: RunResult) -> None:
    """JSON has no NaN; written as null it would look like a figure that was not asked for."""
    verdict = result.goal_verdict
    verdicts = () if verdict is None else (verdict, *verdict.findings)
    corrections = [done for row in result.history for done in row.corrections]
    cameras = () if result.camera is None else (result.camera,)
    for struct in (result, *result.history, *corrections, *verdicts, *cameras):
        for name in struct.__struct_fields__:
            value: object = getattr(struct, name)
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(
                    f"{name} of a result is {value}: it must be a finite number, or None where that is allowed."
                )
