"""Whether a shape can be worked with, and if not, why."""

import enum

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value


class Problem(enum.Enum):
    """What can be wrong with a start or goal shape."""

    OFF_TABLE = "off_table"
    OUT_OF_REACH = "out_of_reach"
    OUT_OF_VIEW = "out_of_view"
    BENDS_TOO_TIGHTLY = "bends_too_tightly"
    CROSSES_ITSELF = "crosses_itself"
    LIES_ON_ITSELF = "lies_on_itself"
    NO_ROOM_FOR_FINGERS = "no_room_for_fingers"
    WRONG_LENGTH = "wrong_length"
    SPRINGS_BACK = "springs_back"


class Finding(Value, frozen=True, kw_only=True, eq=False):
    """One problem of a shape."""

    problem: Problem
    node: int
    """The node where it is worst."""
    amount: float
    """How much there is of what is limited, in `unit`."""
    limit: float
    """The limit that `amount` breaks, in `unit`."""
    unit: str
    """``m`` or ``px``."""
    text: str
    """What is wrong and where, what is allowed, and what to do."""


class Verdict(Value, frozen=True, kw_only=True, eq=False):
    """All problems of a shape; none of them: it is feasible."""

    findings: tuple[Finding, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether there is nothing against it."""
        return not self.findings

    @property
    def reason(self) -> str:
        """Name of the first problem; empty without any."""
        return self.findings[0].problem.value if self.findings else ""

    @property
    def text(self) -> str:
        """All findings, for people."""
        return " ".join(finding.text for finding in self.findings)


class Standing(enum.Enum):
    """What is to be expected of a goal."""

    HOLDS = "holds"
    """Released in it, the DLO stays there, whatever of the model's doubts is true; and the arm gets there."""
    DOUBTFUL = "doubtful"
    """It may hold, or a shape within the threshold does: worth trying, and watching."""
    INFEASIBLE = "infeasible"
    """Nothing within the threshold of it holds, or the arm does not get there."""


class Release(Value, frozen=True, kw_only=True, eq=False):
    """One trial in the model: the DLO laid down as the goal and let go."""

    elastic_factor: float
    """EI / (μ w) of this trial, bending stiffness over friction and weight, over what is believed."""
    nodes_world: Float64Array  # (M, 3) [m] where it came to rest
    rmse_m: float
    """How far it sprang back, over all nodes [m]."""
    node: int
    """The node that sprang back farthest."""
    largest_m: float
    """How far that node did [m]."""


class GoalVerdict(Message, frozen=True, kw_only=True, eq=False):
    """Whether a goal can be reached and will hold, as the model believes."""

    standing: Standing
    threshold_m: float
    """The RMSE below which the goal would count as reached [m]."""
    goal_world: Float64Array  # (M, 3) [m] what was judged
    findings: tuple[Finding, ...] = ()
    """What stands against the goal, by name; none: it holds."""
    releases: tuple[Release, ...] = ()
    """The trials: as believed first, then as stiff on as smooth a table as may be, then as soft on as rough a one,
    then between. None where the DLO would lie across itself."""
    nearest_world: Float64Array | None = None  # (M, 3) [m]
    """The nearest shape found that holds, in reach; None: the goal does, or none was found."""
    nearest_rmse_m: float | None = None
    """How far that shape is from the goal [m]."""

    @property
    def reason(self) -> str:
        """Names of all problems; empty without any."""
        return ", ".join(finding.problem.value for finding in self.findings)

    @property
    def springs_back(self) -> Release | None:
        """The worst trial; None without trials."""
        return max(self.releases, key=lambda release: release.rmse_m, default=None)

    @property
    def text(self) -> str:
        """One line for people: the verdict, everything against the goal, and the nearest shape that holds."""
        parts = [f"The goal {_WORDS[self.standing]}."]
        parts += [finding.text for finding in self.findings]
        if self.nearest_rmse_m is not None:
            parts.append(f"The nearest shape found that holds is {self.nearest_rmse_m * 1000.0:.1f} mm (RMSE) from it.")
        elif self.standing is Standing.INFEASIBLE:
            parts.append("No shape near it was found that holds.")
        return " ".join(parts)


_WORDS = {
    Standing.HOLDS: "holds",
    Standing.DOUBTFUL: "is doubtful",
    Standing.INFEASIBLE: "is infeasible",
}
