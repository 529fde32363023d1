"""What the environments ask of an episode's course, whatever its actions are."""

from dataclasses import dataclass, field
from typing import Any, Protocol

from dlokit.extras.gym.stepped_run import SteppedRun
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.flow import RunOutcome


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """Where an episode is after its beginning or a step."""

    rmse_m: float
    """The system's own estimate of the error to the goal [m]."""
    outcome: RunOutcome | None = None
    """How the course has ended; None: it goes on."""
    reason: str = ""
    """Why it has ended."""
    notes: dict[str, Any] = field(default_factory=dict[str, Any])
    """Of the step, for `info`."""


class EpisodeCourse(Protocol):
    """One episode: a run whose actions come from outside."""

    @property
    def stepped(self) -> SteppedRun:
        """The run."""
        ...

    def begin(self) -> StepResult:
        """Look, set the goal, and come to the first decision. Raises `DlokitError`."""
        ...

    def act(self, vector: Float32Array) -> StepResult:
        """Do what a vector of the action space stands for. Raises `DlokitError` where a component fails."""
        ...

    @property
    def first_world(self) -> Float64Array:
        """The system's first shape (M, 3) [m]."""
        ...
