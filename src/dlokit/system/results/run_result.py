"""`result.json`: the result of a run in figures."""

import hashlib
import math
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import msgspec

from dlokit.decision.records import ActionFigures, ActionRecord, CameraReport, Recovery
from dlokit.description.point_files import csv_of
from dlokit.description.scene import Fixture
from dlokit.errors import InputError
from dlokit.functional.cell.drawn_cell import DrawnCell
from dlokit.recording.disk import write_synced
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.feasibility import GoalVerdict, Problem, Standing
from dlokit.types.flow import RunOutcome
from dlokit.types.passing import Passing
from dlokit.types.robot import ArmProtection

NEAREST_FILE_NAME = "nearest_goal.csv"


class FindingResult(msgspec.Struct, frozen=True, kw_only=True):
    """One reason why a goal may be infeasible."""

    problem: Problem
    node: int
    """Node where the problem is largest."""
    amount: float
    limit: float
    unit: str
    """Unit of amount and limit."""


class VerdictResult(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict on the goal before the robot moved."""

    standing: Standing
    text: str
    findings: tuple[FindingResult, ...] = ()
    springs_back_m: float | None = None
    """Largest RMSE to the goal among simulated releases there [m]; None if none was simulated."""
    nearest_rmse_m: float | None = None
    """RMSE from the goal to the nearest feasible shape [m]; None when no such shape was found or needed."""
    projected: bool = False
    """Whether the run pursued that shape instead; then `rmse_m` and `true_rmse_m` of the result refer to it."""
    asked_rmse_m: float | None = None
    """The last estimated error to the requested goal [m], when the run pursued another."""


def verdict_result(verdict: GoalVerdict, *, projected: bool, asked_rmse_m: float | None) -> VerdictResult:
    """The figures of a verdict."""
    worst = verdict.springs_back
    return VerdictResult(
        standing=verdict.standing,
        text=verdict.text,
        findings=msgspec.convert(verdict.findings, tuple[FindingResult, ...], from_attributes=True),
        springs_back_m=None if worst is None else worst.rmse_m,
        nearest_rmse_m=verdict.nearest_rmse_m,
        projected=projected,
        asked_rmse_m=asked_rmse_m,
    )


def write_nearest(folder: Path, verdict: GoalVerdict) -> None:
    """Write the nearest feasible shape, if any, into a run's folder, in the format of `--goal`."""
    if verdict.nearest_world is not None:
        write_synced(folder / NEAREST_FILE_NAME, csv_of(verdict.nearest_world))


GOAL_FILE_NAME = "goal.csv"
START_FILE_NAME = "start.csv"
"""The shape that an earlier task of the run left, where the camera saw the DLO before this one."""
REPORT_FILE = "report.html"
"""The report for people."""


def write_goal(folder: Path, nodes_world: Float64Array) -> None:
    """Write the goal (M, 3) [m] of a task into its folder, in the format of `--goal`."""
    write_synced(folder / GOAL_FILE_NAME, csv_of(nodes_world))


def write_seen_start(folder: Path, nodes_world: Float64Array) -> None:
    """Write the shape (M, 3) [m] from which a task started into its folder, in the format of `--start`."""
    write_synced(folder / START_FILE_NAME, csv_of(nodes_world))


FILE_NAME = "result.json"


class ActionResult(ActionFigures, frozen=True, kw_only=True):
    """One action, one row of the history."""

    true_rmse_m: float | None = None
    """True error 2 s after the release, by the evaluator [m]; None without ground truth."""


def action_result(action: ActionRecord) -> ActionResult:
    """The figures of an action."""
    return ActionResult(**{name: getattr(action, name) for name in ActionFigures.__struct_fields__})


class CameraResult(msgspec.Struct, frozen=True, kw_only=True):
    """Result of the check of the camera's pose, by observing the robot's hand."""

    text: str
    """Summary in words."""
    offset_x_m: float | None = None
    """Corrected offset of the camera from its calibration along the table [m]; None without a correction."""
    offset_y_m: float | None = None
    yaw_rad: float | None = None
    """Corrected rotation about the vertical [rad]."""
    scatter_m: float | None = None
    """Disagreement of the pictures after the correction (root mean square) [m]."""


class ProtectionResult(msgspec.Struct, frozen=True, kw_only=True):
    """The settings of a real arm and the values that it reported back; see `ArmProtection`."""

    robot: str
    recovered: bool
    torque_nm: float
    force_n: float
    load_kg: float
    load_at_m: tuple[float, ...]
    reported_load_kg: float
    reported_tool_kg: float
    reported_tool_m: tuple[float, ...]
    """Tool centre point in the flange's frame that the arm reports [m]."""
    reported_tool_wxyz: tuple[float, ...]
    """Orientation of the tool in the flange's frame that the arm reports, as a unit quaternion."""


def protection_result(protection: ArmProtection) -> ProtectionResult:
    """The figures of an arm's protection settings."""
    return ProtectionResult(
        robot=protection.robot,
        recovered=protection.recovered,
        torque_nm=protection.torque_nm,
        force_n=protection.force_n,
        load_kg=protection.load_kg,
        load_at_m=tuple(protection.load_at_m.tolist()),
        reported_load_kg=protection.reported_load_kg,
        reported_tool_kg=protection.reported_tool_kg,
        reported_tool_m=tuple(protection.T_flange_tool.position_m.tolist()),
        reported_tool_wxyz=tuple(protection.T_flange_tool.wxyz.tolist()),
    )


class FixtureContact(msgspec.Struct, frozen=True, kw_only=True):
    """Where and when the largest force between an arm and a fixture acted."""

    link: str
    """Link of the arm, e.g. ``"panda/left_finger"``."""
    fixture: str
    stamp_ns: int
    """On the run's clock [ns]."""


class TaskSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One task of a run that takes several."""

    number: int
    """Number of the task in its run, counted from 1."""
    goal: str
    """Name of its goal; empty when no goal was set."""
    outcome: RunOutcome
    actions: int
    """Number of actions that began."""
    unfinished: bool = False
    """Whether the task ended during its last action: `rmse_m` is then the error before it."""
    rmse_m: float | None
    """The last estimate of the error [m]; None when the DLO was not observed."""
    report: str = ""
    """Its report, as a path in the folder of the run; empty where none was written."""


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """The result of a task, with the fields of the file in their order.

    The file of a run that takes several tasks is the result of the last one, with a list of them all.
    """

    outcome: RunOutcome
    reason: str | None = None
    """Why the run did not converge, or which signal stopped it; None when converged."""
    goal: str = ""
    """Name of the goal: a shape's name, or its file's; empty when no goal was set."""
    actions: int
    """Number of actions that began; one during which the run ended is not in `history`."""
    rmse_m: float | None
    """The last estimate of the error [m]; None only when the DLO was never observed."""
    start_rmse_m: float | None = None
    """The first estimate, before any action [m]; None when the run ended before it."""
    true_rmse_m: float | None = None
    """True error 2 s after the last release, by the evaluator [m]; at the end where no action of `history` released the
    DLO; None without ground truth."""
    true_largest_m: float | None = None
    """Largest true distance of a node from its goal at that time [m]; None without ground truth."""
    passing: Passing | None = None
    """How the DLO passes the fixtures at the end, by the last estimate, and if as wished; None without fixtures."""
    true_passing: Passing | None = None
    """The same by the true DLO and fixtures, 2 s after the last release; None without ground truth."""
    largest_fixture_force_n: float | None = None
    """Largest true force between an arm and a fixture so far in the run, by the evaluator [N]; None without fixtures or
    ground truth."""
    fixture_contact: FixtureContact | None = None
    """Where that force acted; None when no arm touched a fixture."""
    threshold_m: float
    seed: int
    sim_time_s: float
    """Time on the run's clock [s]."""
    wall_time_s: float
    planning_time_s: float
    """Wall time spent choosing actions [s]."""
    history: tuple[ActionResult, ...] = ()
    config_hash: str
    version: str
    episode: DrawnCell | None = None
    """Parameters drawn for the cell, unknown to the system; None when nothing is randomised."""
    goal_verdict: VerdictResult | None = None
    """Verdict on the goal; None when the run ended before it was judged."""
    camera: CameraResult | None = None
    """Result of the check of the camera's pose; None when it was not checked."""
    twin: bool = False
    """Whether the arm of a driver moved while camera, DLO and the feedback of the fingers were simulated."""
    interruptions: tuple[str, ...] = ()
    """The cause of each repeated look, by name: a lost component or camera, or the camera's clock."""
    recoveries: tuple[Recovery, ...] = ()
    """Each automatic recovery of an arm that had stopped on its own, without a person."""
    protections: tuple[ProtectionResult, ...] = ()
    """Thresholds and load of real arms, each time they were set; empty without a real arm."""
    task: int | None = None
    """Number of the task in a run that takes several, counted from 1; None where the run has one task."""
    tasks: tuple[TaskSummary, ...] = ()
    """In the folder of a run that takes several tasks: all of them, of which this is the last; empty elsewhere."""

    @property
    def unfinished(self) -> bool:
        """Whether the task ended during an action: `rmse_m` is then the error before it."""
        return self.actions > len(self.history)


def write_result(folder: Path, result: RunResult) -> None:
    """Write `result.json` into a run's folder, whole or not at all. Raises `InputError` for NaN, and `OSError`."""
    _refuse_non_finite(result)
    write_synced(folder / FILE_NAME, msgspec.json.format(msgspec.json.encode(result), indent=2) + b"\n")


def read_result(folder: Path) -> RunResult:
    """Read the result in a run's folder. Raises `InputError` when it is missing or invalid."""
    path = folder / FILE_NAME
    try:
        return msgspec.json.decode(path.read_bytes(), type=RunResult)
    except FileNotFoundError:
        raise InputError(f"{folder} has no {FILE_NAME}: give the folder of a run that has ended.") from None
    except msgspec.DecodeError as error:
        raise InputError(f"{path} is not a valid result of a run ({error}): run it again.") from error


def config_hash(config_toml: str) -> str:
    """Twelve hexadecimal digits that identify a configuration: equal configurations have equal hashes."""
    return hashlib.sha256(config_toml.encode()).hexdigest()[:12]


def _refuse_non_finite(result: RunResult) -> None:
    """JSON has no NaN; null would look like a figure that does not apply."""
    verdict = result.goal_verdict
    verdicts = () if verdict is None else (verdict, *verdict.findings)
    corrections = [done for row in result.history for done in row.corrections]
    cameras = () if result.camera is None else (result.camera,)
    for struct in (result, *result.history, *corrections, *verdicts, *cameras, *result.protections):
        for name in struct.__struct_fields__:
            value: object = getattr(struct, name)
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(
                    f"{name} of a result is {value}: it must be a finite number, or None where that is allowed."
                )


def camera_result(report: CameraReport) -> CameraResult:
    """The figures of a check of the camera's pose."""
    check = report.check
    if check is None:
        return CameraResult(text=report.text)
    x_m, y_m = check.offset_m.tolist()
    return CameraResult(
        text=report.text, offset_x_m=x_m, offset_y_m=y_m, yaw_rad=check.yaw_rad, scatter_m=check.scatter_m
    )


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """Duration of one step of the flow, summed over the run."""

    calls: int
    sim_time_s: float
    """Time on the run's clock [s]."""
    wall_time_s: float
    """Wall time, that of waits and motions included [s]."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run as the system itself observed it, without the ground truth."""

    name: str
    """Display name of the run, e.g. ``"I to S"``."""
    folder: str = ""
    """Name of the folder of the run; empty before it is judged."""
    began: datetime | None = None
    """When the task began, in local time; it ended `result.wall_time_s` later."""
    result: RunResult
    begun: bool = True
    """Whether its task began; a cell that was stopped earlier may have written no ground truth."""
    goal_nodes_world: Float64Array  # (M, 3) [m]
    goal_set: bool = True
    """Whether a goal was set; otherwise the nodes are the start's."""
    fixtures: tuple[Fixture, ...] = ()
    """The believed fixtures."""
    ends_interchangeable: bool = False
    """Whether the reversed goal counts as reached too."""
    verdict: GoalVerdict | None = None
    """Verdict on the goal before the robot moved; None when the run ended earlier."""
    start_nodes_world: Float64Array | None = None  # (M, 3) [m]
    """The first estimate; None when the DLO was never observed."""
    start_stamp_ns: int = 0
    """Stamp of the pictures of the first estimate [ns]."""
    actions: tuple[ActionRecord, ...] = ()
    """Actions with their shapes, in the order of the result's history."""
    timings: Mapping[str, StepTiming] = field(default_factory=dict[str, StepTiming])
    """By step of the flow."""
    image_before: UInt8Array | None = None  # (height, width, 3) RGB
    image_after: UInt8Array | None = None  # (height, width, 3) RGB
    config_toml: str = ""
    parts: Mapping[str, str] = field(default_factory=dict[str, str])
    """Arm, camera, DLO, planner, observer: what they were, for people."""
    changed: Mapping[str, str] = field(default_factory=dict[str, str])
    """The settings that differ from their defaults, by their path in the configuration."""
    command: str = ""
    """The command line that repeats the run; empty where it used objects of the calling program."""
    machine: Mapping[str, str] = field(default_factory=dict[str, str])
    """Machine and versions, e.g. ``{"mujoco": "4.0.0"}``."""
    unwritten: Mapping[str, str] = field(default_factory=dict[str, str])
    """Files of the run that could not be written, each with the reason."""


PACKAGES = ("dlokit", "mujoco", "numpy", "opencv-python-headless", "mink", "ruckig", "eclipse-zenoh")


def machine_facts() -> dict[str, str]:
    """Machine, interpreter and the versions that a result depends on."""
    facts = {
        "system": f"{platform.system()} {platform.machine()}",
        "cores": str(os.cpu_count()),
        "python": platform.python_version(),
    }
    return facts | {package: version(package) for package in PACKAGES}
