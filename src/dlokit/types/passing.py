"""How a DLO passes fixtures: what is wished, and what is found."""

import enum
from collections.abc import Mapping
from typing import Annotated

from msgspec import Meta

from dlokit.types.message import Value

Turn = Annotated[int, Meta(ge=-1, le=1)]
TURNS: Mapping[int, str] = {1: "clockwise", -1: "counterclockwise", 0: "closely"}
"""Turns of a DLO about a post, seen from above, from its first to its last node. A post on its right is turned about
clockwise; in a wish, 0 is closely, on either side."""


class SideWish(Value, frozen=True, kw_only=True, eq=True):
    """How a DLO is to pass one post."""

    name: str
    turn: Turn = 0


class PostPassing(Value, frozen=True, kw_only=True, eq=True, tag="post", tag_field="kind"):
    """How a DLO passes one post."""

    name: str
    side: Turn
    """1 or -1, the sign of its turn as in `TURNS`; 0: it does not pass the post, or lies over it."""
    winding_rad: float
    """Angle by which it turns about the post's axis within 50 mm of it, clockwise positive [rad]."""
    along_m: float
    """Arc length from the first node to the point nearest to the axis [m]: the order of the fixtures."""
    distance_m: float
    """Distance of that point from the axis [m]."""
    over: bool = False
    """Whether it lies over the post's head."""


class BoxPassing(Value, frozen=True, kw_only=True, eq=True, tag="box", tag_field="kind"):
    """How a DLO passes one box, seen from above."""

    name: str
    along_m: float
    """Arc length from the first node to the point nearest to the box [m]."""
    distance_m: float
    """Distance of that point from the box [m]; 0: it lies over the box."""


class AsWished(enum.Enum):
    """Whether a DLO passes a post as wished."""

    YES = "yes"
    NO = "no"
    NOT_SEEN = "not_seen"
    """What decides it is hidden, or smaller than the uncertainty."""


class SideAnswer(Value, frozen=True, kw_only=True, eq=True):
    """Whether a DLO passes one named post as wished."""

    name: str
    turn: Turn
    """The wished turn."""
    answer: AsWished
    margin_m: float
    """How far the DLO may at least be from its estimate before the answer changes [m]."""
    why: str = ""
    """What is not as wished, e.g. "passes A clockwise"; empty if the answer is yes."""


class Passing(Value, frozen=True, kw_only=True, eq=True):
    """How a DLO passes fixtures."""

    fixtures: tuple[PostPassing | BoxPassing, ...]
    """One record a fixture."""
    answers: tuple[SideAnswer, ...] = ()
    """In the order of the wish."""
    unnamed: tuple[str, ...] = ()
    """Posts that the wish does not name and the DLO passes within 50 mm of their axes; empty without a wish."""
    slack: float | None = None
    """Length of the DLO between the first and the last named post, over that of straight lines that pass all named ones
    on the same sides; None for fewer than two."""

    @property
    def why(self) -> str:
        """What is not as wished, as a clause; empty if all is."""
        wrong = ", ".join(one.why for one in self.answers if one.answer is not AsWished.YES)
        return f"the DLO {wrong}" if wrong else ""
