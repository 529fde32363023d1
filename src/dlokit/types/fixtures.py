"""The result of a look at the fixtures: what stands on the table, compared with what is believed to stand there."""

import enum

import numpy as np

from dlokit.types.arrays import Float64Array
from dlokit.types.message import Message, Value


class FixtureSight(enum.Enum):
    """How a fixture is seen."""

    AS_BELIEVED = "as_believed"
    MOVED = "moved"
    OTHER_SIZE = "other_size"
    MISSING = "missing"
    UNKNOWN = "unknown"
    """Something stands where no fixture is believed to be."""
    NOT_SEEN = "not_seen"
    """It is hidden, out of the picture or the box, or too low to be told from the table."""


ACCEPTED = frozenset({FixtureSight.AS_BELIEVED, FixtureSight.NOT_SEEN})
"""Sights with which an arm may move."""


class FixtureFinding(Value, frozen=True, kw_only=True, eq=False):
    """What a look says about one fixture, or about one unknown thing."""

    name: str
    """The fixture's name; empty for an unknown thing."""
    sight: FixtureSight
    place_world: Float64Array  # (2,) x, y [m] of its middle: as seen, or as believed where it is not seen
    offset_m: Float64Array  # (2,) x, y [m] from the believed to the seen place; 0 where it is not seen
    larger_m: Float64Array  # (2,) [m] how much wider and higher it looks than believed; an unknown thing's size

    @property
    def text(self) -> str:
        """The finding as a clause, for people."""
        (dx, dy), (x, y), (wider, higher) = 1e3 * self.offset_m, self.place_world, 1e3 * self.larger_m
        off_mm = float(np.hypot(dx, dy))
        return {
            FixtureSight.AS_BELIEVED: f"{self.name} stands where it is believed to be",
            FixtureSight.MOVED: f"{self.name} stands {off_mm:.0f} mm (x {dx:+.0f}, y {dy:+.0f}) off its place",
            FixtureSight.OTHER_SIZE: f"{self.name} has another size: it looks {wider:+.0f} mm wider and {higher:+.0f} "
            "mm higher",
            FixtureSight.MISSING: f"{self.name} is missing at ({x:.3f}, {y:.3f}) m",
            FixtureSight.NOT_SEEN: f"{self.name} is not seen",
            FixtureSight.UNKNOWN: f"an unknown thing, {wider:.0f} mm wide and {higher:.0f} mm high, is at ({x:.3f}, "
            f"{y:.3f}) m",
        }[self.sight]


class FixtureCheck(Message, frozen=True, kw_only=True, eq=False):
    """Result of a look at the fixtures; its stamp is that of the first picture."""

    findings: tuple[FixtureFinding, ...]
    """One for each believed fixture, in their order, then one for each unknown thing."""
    camera_offset_m: Float64Array  # (2,) x, y [m]
    """Common shift of the fixtures, which is the camera's error and in no finding's offset; 0 if there are too few."""
