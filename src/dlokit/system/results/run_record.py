"""The record of a run in memory, for the evaluator and for the report."""

import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import version

from dlokit.decision.records import ActionRecord
from dlokit.system.results.run_result import RunResult
from dlokit.types.arrays import Float64Array, UInt8Array
from dlokit.types.feasibility import GoalVerdict


@dataclass(frozen=True, kw_only=True)
class StepTiming:
    """Duration of one step of the flow, summed over the run."""

    calls: int
    sim_time_s: float
    """Time on the run's clock [s]."""
    wall_time_s: float
    """Wall time of the computation [s]."""


@dataclass(frozen=True, kw_only=True)
class RunRecord:
    """A run as the system itself observed it, without the ground truth."""

    name: str
    """Display name, e.g. ``"I to S"``."""
    result: RunResult
    begun: bool = True
    """Whether its task began; a cell that was stopped before may have left no truth."""
    goal_nodes_world: Float64Array  # (M, 3) [m]
    goal_set: bool = True
    """Whether a goal was set; where none was, the nodes are those of the start."""
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
    command: str = ""
    """The command line that repeats the run."""
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
