"""`result.json`: what became of a run, in figures."""

import hashlib
import math
from pathlib import Path

import msgspec
import numpy as np

from dlokit.decision.records import ActionRecord, CameraReport, CorrectionRecord
from dlokit.errors import InputError
from dlokit.functional.cell.episode import Episode
from dlokit.geometry import rmse_m
from dlokit.types.feasibility import GoalVerdict, Problem, Standing
from dlokit.types.flow import RunOutcome

NEAREST_FILE_NAME = "nearest_goal.csv"


class FindingResult(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that stands against a goal."""

    problem: Problem
    node: int
    """Where it is worst."""
    amount: float
    limit: float
    unit: str
    """Of amount and limit."""


class VerdictResult(msgspec.Struct, frozen=True, kw_only=True):
    """What was said of the goal before the robot moved."""

    standing: Standing
    text: str
    findings: tuple[FindingResult, ...] = ()
    springs_back_m: float | None = None
    """RMSE to the goal after a release in it, in the worst trial [m]; None without trials."""
    nearest_rmse_m: float | None = None
    """How far the nearest shape found that holds is from the goal [m]; None when there is none, or no need of one."""
    projected: bool = False
    """Whether the run went for that shape instead; the result's `rmse_m` and `true_rmse_m` are to it, then."""
    asked_rmse_m: float | None = None
    """The last estimate of the error to the goal that was asked for [m], when the run went for another."""


def verdict_result(verdict: GoalVerdict, *, projected: bool, asked_rmse_m: float | None) -> VerdictResult:
    """A verdict in figures."""
    worst = verdict.springs_back
    return VerdictResult(
        standing=verdict.standing,
        text=verdict.text,
        findings=tuple(
            FindingResult(
                problem=finding.problem,
                node=finding.node,
                amount=finding.amount,
                limit=finding.limit,
                unit=finding.unit,
            )
            for finding in verdict.findings
        ),
        springs_back_m=None if worst is None else worst.rmse_m,
        nearest_rmse_m=verdict.nearest_rmse_m,
        projected=projected,
        asked_rmse_m=asked_rmse_m,
    )


def write_nearest(folder: Path, verdict: GoalVerdict) -> Path | None:
    """Write the nearest shape that holds into a run's folder, as `--goal` takes it; None when there is none."""
    if verdict.nearest_world is None:
        return None
    path = folder / NEAREST_FILE_NAME
    np.savetxt(path, verdict.nearest_world, fmt="%.6f", delimiter=",", header="x,y,z", comments="")
    return path


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


def action_result(action: ActionRecord) -> ActionResult:
    """The figures of an action."""
    return ActionResult(
        action=action.action,
        kind=action.kind,
        grasp_node=action.grasp_node,
        grasp_ok=action.grasp_ok,
        slipped=action.slipped,
        rmse_m=action.rmse_m,
        predicted_rmse_m=action.predicted_rmse_m,
        missed_m=None if action.expected_world is None else rmse_m(action.nodes_world, action.expected_world),
        duration_s=action.duration_s,
        robot_time_s=action.robot_time_s,
        path_length_m=action.path_length_m,
        planning_time_s=action.planning_time_s,
        corrections=tuple(_correction(done) for done in action.corrections),
        control_end=action.control_end or None,
        ended_by=action.ended_by or None,
    )


def _correction(done: CorrectionRecord) -> CorrectionResult:
    x_m, y_m, z_m, yaw_rad = done.displacement.tolist()
    return CorrectionResult(
        x_m=x_m,
        y_m=y_m,
        z_m=z_m,
        yaw_rad=yaw_rad,
        before_m=done.before_m,
        predicted_m=done.predicted_m,
        seen_m=done.seen_m,
    )


def camera_result(report: CameraReport) -> CameraResult:
    """The figures of a check of the camera's place."""
    check = report.check
    if check is None:
        return CameraResult(text=report.text)
    x_m, y_m = check.offset_m.tolist()
    return CameraResult(
        text=report.text, offset_x_m=x_m, offset_y_m=y_m, yaw_rad=check.yaw_rad, scatter_m=check.scatter_m
    )
