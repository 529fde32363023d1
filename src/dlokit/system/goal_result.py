"""What a run's result says of its goal: the verdict in figures, and the nearest shape that holds as a file."""

from pathlib import Path

import msgspec
import numpy as np

from dlokit.types.feasibility import GoalVerdict, Problem, Standing

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
