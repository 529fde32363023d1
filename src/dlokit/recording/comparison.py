"""What a component did in a recorded run beside what it did when it was fed that run again, field by field."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.recording.call_log import end_of
from dlokit.recording.feeding import Asked, Heard, Replayed, Timeline
from dlokit.recording.plain import from_json
from dlokit.recording.tolerances import Tolerance, tolerance_of
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome, Succeeded

CLOUD_FIELD = "points_world"
"""Points in no order: compared as a cloud, not one by one."""
PICTURE_FIELD = "depth_m"
"""A picture: pixels at edges may fall on the other side."""
QUANTILE = 0.95
"""Share of a cloud's points, or a picture's pixels, that a deviation speaks of."""


def deviations(recorded: Any, replayed: Any, field: str = "") -> Iterator[tuple[str, float]]:
    """Every field within two values, by its path, with how far it is apart.

    Numbers and arrays: the largest difference, in the field's unit; arrays of truth values: how many differ; clouds:
    the 95th percentile of the distances from a point to the nearest of the other cloud, both ways; depth: the 95th
    percentile of the differences; everything else: 0 when equal. Infinite where the two cannot be compared: another
    type, shape or length.
    """
    if isinstance(recorded, msgspec.Struct) and type(recorded) is type(replayed):
        for name in recorded.__struct_fields__:
            path = f"{field}.{name}" if field else name
            yield from deviations(getattr(recorded, name), getattr(replayed, name), path)
    elif isinstance(recorded, tuple | list) and isinstance(replayed, tuple | list):
        if len(recorded) != len(replayed):
            yield field, math.inf
            return
        for one, other in zip(recorded, replayed, strict=True):
            yield from deviations(one, other, f"{field}[]")
    else:
        yield field, _apart(recorded, replayed, field)


def _apart(recorded: Any, replayed: Any, field: str) -> float:
    if isinstance(recorded, np.ndarray) and isinstance(replayed, np.ndarray):
        if field.endswith(CLOUD_FIELD):
            return _clouds_apart(recorded, replayed)
        return _arrays_apart(recorded, replayed, QUANTILE if field.endswith(PICTURE_FIELD) else 1.0)
    if type(recorded) is type(replayed) and isinstance(recorded, int | float) and not isinstance(recorded, bool):
        return float(_difference(np.asarray(recorded, float), np.asarray(replayed, float)).max())
    return 0.0 if type(recorded) is type(replayed) and recorded == replayed else math.inf


def _arrays_apart(recorded: NDArray[Any], replayed: NDArray[Any], quantile: float) -> float:
    if recorded.shape != replayed.shape or recorded.dtype != replayed.dtype:
        return math.inf
    if recorded.size == 0:
        return 0.0
    if recorded.dtype.kind == "b":
        return float(np.count_nonzero(recorded != replayed))
    apart = _difference(recorded.astype(float), replayed.astype(float))
    return float(np.quantile(apart, quantile, method="lower"))


def _difference(recorded: NDArray[Any], replayed: NDArray[Any]) -> NDArray[Any]:
    """Of each element; what is not a number, or infinite the same way, on both sides is equal."""
    same = (recorded == replayed) | (np.isnan(recorded) & np.isnan(replayed))
    with np.errstate(invalid="ignore"):
        apart = np.abs(recorded - replayed)
    return np.where(same, 0.0, np.where(np.isnan(apart), math.inf, apart))


def _clouds_apart(recorded: NDArray[Any], replayed: NDArray[Any]) -> float:
    if len(recorded) == 0 or len(replayed) == 0:
        return 0.0 if len(recorded) == len(replayed) else math.inf
    both = (
        np.quantile(KDTree(mine).query(theirs)[0], QUANTILE)
        for mine, theirs in ((recorded, replayed), (replayed, recorded))
    )
    return float(max(both))


MESSAGES, OUTCOME = "(messages)", "outcome"
"""Rows beside those of fields: how many have no counterpart; how many ended in another outcome."""


@dataclass(frozen=True, kw_only=True)
class FieldRow:
    """One field of one topic or skill, over the whole recording."""

    what: str
    """Topic, or ``component.skill``."""
    field: str
    compared: int
    largest: float
    """Largest deviation, as `deviations` has it; infinite when something could not be compared at all."""
    at_ns: int
    """Where that was: the stamp of the recorded message, or of the end of the call [ns]."""
    tolerance: Tolerance

    @property
    def within(self) -> bool:
        """Whether the deviation is within its tolerance."""
        return self.largest <= self.allowed

    @property
    def allowed(self) -> float:
        """The largest deviation that is."""
        return self.tolerance.largest * (self.compared if self.tolerance.share else 1)


class _Rows:
    def __init__(self, live: bool, same_processor: bool) -> None:
        self._live, self._same_processor = live, same_processor
        self._found: dict[tuple[str, str], tuple[int, float, int]] = {}

    def add(self, what: str, field: str, apart: float, at_ns: int, compared: int = 1) -> None:
        count, largest, where = self._found.get((what, field), (0, -1.0, 0))
        if apart > largest:
            largest, where = apart, at_ns
        self._found[what, field] = (count + compared, largest, where)

    def rows(self) -> list[FieldRow]:
        return [
            FieldRow(
                what=what,
                field=field,
                compared=count,
                largest=largest,
                at_ns=at_ns,
                tolerance=tolerance_of(what, field, live=self._live, same_processor=self._same_processor),
            )
            for (what, field), (count, largest, at_ns) in self._found.items()
        ]


def compare(
    recorded: Timeline,
    replayed: Replayed,
    *,
    live: bool,
    same_processor: bool,
    left_out: Collection[int] = (),
    uncompared: Collection[str] = (),
) -> list[FieldRow]:
    """A row a field, topics first, in the order of their first message.

    Messages with a stamp in `left_out`, and the topics and skills named in `uncompared`, are not looked at. `live` is
    whether the run was live, `same_processor` whether it rounded as this process does: tolerances differ.
    """
    rows = _Rows(live, same_processor)
    mine = _by_topic(recorded.said, left_out)
    theirs = _by_topic(replayed.said, left_out)
    for name in dict.fromkeys((*mine, *theirs)):
        if name not in uncompared:
            _compare_topic(rows, name, mine.get(name, []), theirs.get(name, []))
    answered = {id(asked): outcome for asked, outcome in replayed.answers}
    for event in recorded.events:
        if isinstance(event, Asked) and event.skill.key not in uncompared:
            _compare_call(rows, event, answered.get(id(event)), left_out)
    return rows.rows()


def _by_topic(said: Iterable[Heard], left_out: Collection[int]) -> dict[str, list[Heard]]:
    found: defaultdict[str, list[Heard]] = defaultdict(list)
    for one in said:
        if one.message.stamp_ns not in left_out:
            found[one.topic.name].append(one)
    return found


def _compare_topic(rows: _Rows, name: str, mine: Sequence[Heard], theirs: Sequence[Heard]) -> None:
    pairs = _paired(mine, theirs)
    without = len(mine) + len(theirs) - 2 * len(pairs)
    first = next((one for one in (*mine, *theirs)), None)
    rows.add(name, MESSAGES, float(without), 0 if first is None else first.message.stamp_ns, len(mine))
    for one, other in pairs:
        for field, apart in deviations(one.message, other.message):
            if field != "seq":  # a recording may begin later than its publisher
                rows.add(name, field, apart, one.message.stamp_ns)


def _paired(mine: Sequence[Heard], theirs: Sequence[Heard]) -> list[tuple[Heard, Heard]]:
    """By their order when there are as many, else by their stamps."""
    if len(mine) == len(theirs):
        return list(zip(mine, theirs, strict=True))
    waiting: defaultdict[int, list[Heard]] = defaultdict(list)
    for one in theirs:
        waiting[one.message.stamp_ns].append(one)
    return [(one, found.pop(0)) for one in mine if (found := waiting[one.message.stamp_ns])]


def _compare_call(rows: _Rows, asked: Asked, outcome: Outcome[Any] | None, left_out: Collection[int]) -> None:
    name, record = asked.skill.key, asked.answer
    if outcome is None:
        rows.add(name, OUTCOME, math.inf, record.stamp_ns)
        return
    end, reason, _ = end_of(outcome)
    same = (end, reason) == (record.outcome, record.reason)
    rows.add(name, OUTCOME, 0.0 if same else math.inf, record.stamp_ns)
    if not (same and isinstance(outcome, Succeeded) and record.result):
        return
    if isinstance(outcome.result, Message) and outcome.result.stamp_ns in left_out:
        return
    result: Any = from_json(record.result.encode(), asked.skill.types["return"])
    for field, apart in deviations(result, outcome.result, "result"):
        if field != "result.seq":
            rows.add(name, field, apart, record.stamp_ns)
