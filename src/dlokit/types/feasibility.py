"""Feasibility of start and goal shapes: problems found, and the verdict on a goal."""

import enum

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value


class Problem(enum.Enum):
    """Kinds of problems of a start or goal shape."""

    OFF_TABLE = "off_table"
    OUT_OF_REACH = "out_of_reach"
    OUT_OF_VIEW = "out_of_view"
    BENDS_TOO_TIGHTLY = "bends_too_tightly"
    CROSSES_ITSELF = "crosses_itself"
    LIES_ON_ITSELF = "lies_on_itself"
    NO_ROOM_FOR_FINGERS = "no_room_for_fingers"
    OVERLAPS_FIXTURE = "overlaps_fixture"
    WRONG_LENGTH = "wrong_length"
    SPRINGS_BACK = "springs_back"


class Finding(Value, frozen=True, kw_only=True, eq=False):
    """One problem of a shape."""

    problem: Problem
    node: int
    """Node where the problem is worst."""
    amount: float
    """Value of the limited quantity, in `unit`."""
    limit: float
    """Limit that `amount` violates, in `unit`."""
    unit: str
    """``m`` or ``px``."""
    text: str
    """Sentence for the user: the problem and its place, the limit, and the remedy."""


class Verdict(Value, frozen=True, kw_only=True, eq=False):
    """All problems of a shape; a shape without problems is feasible."""

    findings: tuple[Finding, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether no problem was found."""
        return not self.findings

    @property
    def reason(self) -> str:
        """Name of the first problem; empty if feasible."""
        return self.findings[0].problem.value if self.findings else ""

    @property
    def text(self) -> str:
        """All findings as one text for the user."""
        return " ".join(finding.text for finding in self.findings)


class Standing(enum.Enum):
    """Predicted feasibility of a goal."""

    HOLDS = "holds"
    """Released in the goal shape, the DLO stays there for all parameters within the belief, and the arm reaches it."""
    DOUBTFUL = "doubtful"
    """The goal may hold, or a shape within the threshold of it does: worth an attempt."""
    INFEASIBLE = "infeasible"
    """No shape within the threshold of the goal holds, or the arm cannot reach it."""


class Release(Value, frozen=True, kw_only=True, eq=False):
    """One simulated release: the DLO is placed in the goal shape and released."""

    elastic_factor: float
    """EI / (μ w) in this simulation, relative to the believed value."""
    nodes_world: Float64Array  # (M, 3) [m] shape at rest after the release
    rmse_m: float
    """Spring-back over all nodes (root mean square) [m]."""
    node: int
    """Node with the largest spring-back."""
    largest_m: float
    """Spring-back of that node [m]."""


class GoalVerdict(Message, frozen=True, kw_only=True, eq=False):
    """Whether the model predicts that a goal can be reached and will hold."""

    standing: Standing
    threshold_m: float
    """RMSE below which the goal counts as reached [m]."""
    goal_world: Float64Array  # (M, 3) [m] the goal that was assessed
    findings: tuple[Finding, ...] = ()
    """Problems of the goal; empty: it holds."""
    releases: tuple[Release, ...] = ()
    """Simulated releases: with the believed parameters first, then with the largest and the smallest EI / (μ w) within
    the belief, then with values in between. Empty if the DLO would cross itself."""
    nearest_world: Float64Array | None = None  # (M, 3) [m]
    """Nearest shape found that holds and is reachable; None: the goal itself holds, or none was found."""
    nearest_rmse_m: float | None = None
    """RMSE of that shape to the goal [m]."""

    @property
    def reason(self) -> str:
        """Names of all problems; empty without problems."""
        return ", ".join(finding.problem.value for finding in self.findings)

    @property
    def springs_back(self) -> Release | None:
        """The simulated release with the largest spring-back; None without releases."""
        return max(self.releases, key=lambda release: release.rmse_m, default=None)

    @property
    def text(self) -> str:
        """One line for the user: the verdict, all findings, and the nearest shape that holds."""
        parts = [f"The goal {_PREDICATES[self.standing]}."]
        parts += [finding.text for finding in self.findings]
        if self.nearest_rmse_m is not None:
            parts.append(
                f"The nearest shape found that holds has an RMSE of {self.nearest_rmse_m * 1000.0:.1f} mm to it."
            )
        elif self.standing is Standing.INFEASIBLE:
            parts.append("No shape near it was found that holds.")
        return " ".join(parts)


_PREDICATES = {
    Standing.HOLDS: "holds",
    Standing.DOUBTFUL: "is doubtful",
    Standing.INFEASIBLE: "is infeasible",
}
