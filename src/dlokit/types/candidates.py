"""What a planner considers while it decides, for whoever watches."""

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value


class CandidateSeen(Value, frozen=True, kw_only=True, eq=False):
    """One action that is considered."""

    kind: str
    """In words, as `types.action.kind_of` has it."""
    node: int
    """The node that would be grasped or pushed."""
    score_m: float
    """What would remain to be done, as the planner judges it [m]; less is better."""
    nodes_world: Float64Array  # (M, 3) [m] expected after it
    path_world: Float64Array  # (W, 3) [m] of the tool


class Candidates(Message, frozen=True, kw_only=True, eq=False):
    """How far a decision is: what was played through so far, and the best of it."""

    rollouts: int
    """Played through so far."""
    budget: int
    """To be played through, at most."""
    best: tuple[CandidateSeen, ...] = ()
    """The best few, best first."""
