"""The interface of an episode's course to the environments, for any kind of actions."""

from dataclasses import dataclass, field
from typing import Any, Protocol

from dlokit.extras.gym.stepped_run import SteppedRun
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.flow import RunOutcome


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """State of an episode after its beginning or a step."""

    rmse_m: float
    """The system's own estimate of the error to the goal [m]."""
    outcome: RunOutcome | None = None
    """Outcome of the course; None: it continues."""
    reason: str = ""
    """Reason of the end."""
    notes: dict[str, Any] = field(default_factory=dict[str, Any])
    """Values of the step for `info`."""


class EpisodeCourse(Protocol):
    """One episode: a run whose actions come from its caller."""

    @property
    def stepped(self) -> SteppedRun:
        """The run."""
        ...

    def begin(self) -> StepResult:
        """Look, set the goal, and run to the first decision. Raises `DlokitError`."""
        ...

    def act(self, vector: Float32Array) -> StepResult:
        """Execute the action of a vector of the action space. Raises `DlokitError` if a component fails."""
        ...

    @property
    def first_world(self) -> Float64Array:
        """The system's first shape (M, 3) [m]."""
        ...
