"""Compares a component's recorded messages and answers with its replay, field by field, within tolerances."""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from dlokit.errors import CommunicationError
from dlokit.recording.component_replay import RecordedCall, ReplayResult, TimedMessage, Timeline
from dlokit.recording.message_json import from_json
from dlokit.types.message import Message
from dlokit.types.outcome import Outcome, Succeeded


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """Tolerance of the fields that match both patterns; the first matching row of the table applies."""

    what: str
    """Pattern of topics and skills, e.g. ``"perception*"``."""
    field: str
    """Pattern of the field's path, e.g. ``"*.position_m"``."""
    largest: float
    """Largest allowed deviation."""
    why: str
    is_fraction: bool = False
    """Whether `largest` is a fraction of the number of compared items instead of a deviation."""


_PICTURES = (
    Tolerance(what="perception*", field="*points_world", largest=0.003, why="images are recorded as JPEG"),
    Tolerance(what="perception*", field="*position_m", largest=0.001, why="images are recorded as JPEG"),
    Tolerance(what="perception*", field="*wxyz", largest=0.001, why="images are recorded as JPEG"),
    Tolerance(
        what="perception*", field="*depth_m", largest=0.003, why="the camera's pose, from images recorded as JPEG"
    ),
    Tolerance(what="perception.*", field="result.points", largest=50, why="images are recorded as JPEG"),
    Tolerance(what="perception.check_camera", field="result.*", largest=0.001, why="images are recorded as JPEG"),
    Tolerance(what="perception.check_fixtures", field="*larger_m", largest=0.02, why="images are recorded as JPEG"),
    Tolerance(what="perception.check_fixtures", field="*_m", largest=0.003, why="images are recorded as JPEG"),
    Tolerance(what="perception.check_fixtures", field="*_world", largest=0.003, why="images are recorded as JPEG"),
)

_OLDER = (
    Tolerance(
        what="planning*",
        field="*robot",
        largest=math.inf,
        why="the name of an arm is the installation's, and was another one in older recordings",
    ),
    Tolerance(what="observer*", field="*prior_stamp_ns", largest=math.inf, why="older recordings do not have it"),
)

SAME_PROCESSOR = (
    *_PICTURES,
    *_OLDER,
    Tolerance(
        what="*",
        field="*",
        largest=1e-9,
        why="recorded with this processor and these versions, where runs are identical to the bit; allows for sums in "
        "another order. Values that are not numbers must be equal",
    ),
)
"""For a lockstep run, where messages arrive when they are sent, recorded on a machine with the same rounding."""

TOLERANCES = (
    *_PICTURES,
    *_OLDER,
    Tolerance(
        what="*",
        field="*",
        largest=1e-6,
        why="recorded with another processor or other versions, which round differently; a micrometre is a thousand "
        "times the resulting difference. Values that are not numbers must be equal",
    ),
)
"""For a lockstep run that was recorded on another machine."""

LIVE_TOLERANCES = (
    Tolerance(
        what="model/state",
        field="(messages)",
        largest=0.25,
        is_fraction=True,
        why="it follows the arm's states, and the recording does not show which of them the model missed",
    ),
    Tolerance(
        what="model/belief", field="(messages)", largest=1, why="the first is published before the recorder subscribes"
    ),
    *_OLDER,
    Tolerance(what="*", field="*stamp_ns", largest=2e8, why="each process stamps with its own clock"),
    Tolerance(what="model/state", field="nodes_world", largest=0.01, why="the arm moves 5 mm between two states"),
    Tolerance(what="model/state", field="tracking_error_m", largest=0.001, why="as for the nodes"),
    Tolerance(what="perception*", field="*pins[[]].position_world", largest=0.01, why="as for the model's nodes"),
    Tolerance(what="perception*", field="*depth_m", largest=0.01, why="depth of the arm, as for the model's nodes"),
    Tolerance(what="*", field="*nodes_world", largest=1e-4, why="as for tracking_error_m, of one node"),
    Tolerance(what="*", field="*health", largest=0.01, why="a fraction of points, of which one may cross a limit"),
    *TOLERANCES,
)
"""For a live run, where messages between processes have a latency that is not recorded."""


def tolerance_of(what: str, field: str, *, live: bool, same_processor: bool) -> Tolerance:
    """The row of the table that applies to a field of a topic or skill."""
    lockstep = SAME_PROCESSOR if same_processor else TOLERANCES
    table = LIVE_TOLERANCES if live else lockstep
    return next(row for row in table if fnmatchcase(what, row.what) and fnmatchcase(field, row.field))


CLOUD_FIELD = "points_world"
"""Unordered points: compared as a cloud, not one by one."""
IMAGE_FIELD = "depth_m"
"""A depth image, in which pixels at edges may get the depth of the other side."""
SMALL_CLOUD = 10
"""Clouds with fewer points are noise that no observer uses: they count as equal."""
QUANTILE = 0.95
"""Quantile of the deviations over a cloud's points or an image's pixels that is compared."""


def deviations(recorded: Any, replayed: Any, field: str = "") -> Iterator[tuple[str, float]]:
    """Yield the path and the deviation of each field between two values.

    Numbers and arrays: the largest difference, in the field's unit; Boolean arrays: the number of differences; clouds:
    the 95th percentile of the distances from a point to the nearest of the other cloud, in both directions, 0 where
    both have fewer than 10 points; depth: the 95th percentile of the differences; everything else: 0 if equal. Infinite
    if type, shape or length differ.
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
    elif isinstance(recorded, dict) and isinstance(replayed, dict):
        if recorded.keys() != replayed.keys():
            yield field, math.inf
            return
        for name in recorded:
            yield from deviations(recorded[name], replayed[name], f"{field}.{name}")
    else:
        yield field, _deviation(recorded, replayed, field)


def _deviation(recorded: Any, replayed: Any, field: str) -> float:
    if isinstance(recorded, np.ndarray) and isinstance(replayed, np.ndarray):
        if field.endswith(CLOUD_FIELD):
            return _clouds_deviation(recorded, replayed)
        return _arrays_deviation(recorded, replayed, QUANTILE if field.endswith(IMAGE_FIELD) else 1.0)
    if type(recorded) is type(replayed) and isinstance(recorded, int | float) and not isinstance(recorded, bool):
        return float(_difference(np.asarray(recorded, float), np.asarray(replayed, float)).max())
    return 0.0 if type(recorded) is type(replayed) and recorded == replayed else math.inf


def _arrays_deviation(recorded: NDArray[Any], replayed: NDArray[Any], quantile: float) -> float:
    if recorded.shape != replayed.shape or recorded.dtype != replayed.dtype:
        return math.inf
    if recorded.size == 0:
        return 0.0
    if recorded.dtype.kind == "b":
        return float(np.count_nonzero(recorded != replayed))
    apart = _difference(recorded.astype(float), replayed.astype(float))
    return float(np.quantile(apart, quantile, method="lower"))


def _difference(recorded: NDArray[Any], replayed: NDArray[Any]) -> NDArray[Any]:
    """Absolute difference of each element; two NaN, or two equal infinities, differ by 0."""
    same = (recorded == replayed) | (np.isnan(recorded) & np.isnan(replayed))
    with np.errstate(invalid="ignore"):
        apart = np.abs(recorded - replayed)
    return np.where(same, 0.0, np.where(np.isnan(apart), math.inf, apart))


def _clouds_deviation(recorded: NDArray[Any], replayed: NDArray[Any]) -> float:
    if max(len(recorded), len(replayed)) < SMALL_CLOUD:
        return 0.0
    if len(recorded) == 0 or len(replayed) == 0:
        return 0.0 if len(recorded) == len(replayed) else math.inf
    both = (
        np.quantile(KDTree(cloud).query(other)[0], QUANTILE)
        for cloud, other in ((recorded, replayed), (replayed, recorded))
    )
    return float(max(both))


MESSAGES, OUTCOME = "(messages)", "outcome"
"""Rows besides the fields: number of messages without a counterpart; number of calls with another outcome."""
RETURNED_ANOTHER_TYPE = frozenset({"perception.look"})
"""Skills that returned another type in older recordings: a result that cannot be read as the present one is skipped."""


@dataclass(frozen=True, kw_only=True)
class FieldRow:
    """One field of one topic or skill, over the whole recording."""

    what: str
    """Topic, or ``component.skill``."""
    field: str
    compared: int
    largest: float
    """Largest deviation, as defined by `deviations`."""
    at_ns: int
    """Where it occurred: stamp of the recorded message, or of the end of the call [ns]."""
    tolerance: Tolerance

    @property
    def within(self) -> bool:
        """Whether the deviation is within the tolerance."""
        return self.largest <= self.allowed

    @property
    def allowed(self) -> float:
        """Largest allowed deviation."""
        return self.tolerance.largest * (self.compared if self.tolerance.is_fraction else 1)


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
    replayed: ReplayResult,
    *,
    live: bool,
    same_processor: bool,
    left_out: Collection[int] = (),
    uncompared: Collection[str] = (),
) -> list[FieldRow]:
    """Compare a replay with its recording: one row for each field, topics first, in the order of their first message.

    Messages with a stamp in `left_out`, and the topics and skills named in `uncompared`, are skipped. The tolerances
    depend on `live`, whether the run was live, and on `same_processor`, whether it rounded as this process does.
    """
    rows = _Rows(live, same_processor)
    before = _by_topic(recorded.published, left_out)
    after = _by_topic(replayed.published, left_out)
    for name in dict.fromkeys((*before, *after)):
        if name not in uncompared:
            _compare_topic(rows, name, before.get(name, []), after.get(name, []))
    answered = {id(call): outcome for call, outcome in replayed.answers}
    for event in recorded.events:
        if isinstance(event, RecordedCall) and event.skill.key not in uncompared:
            _compare_call(rows, event, answered.get(id(event)), left_out)
    return rows.rows()


def _by_topic(messages: Iterable[TimedMessage], left_out: Collection[int]) -> dict[str, list[TimedMessage]]:
    found: defaultdict[str, list[TimedMessage]] = defaultdict(list)
    for one in messages:
        if one.message.stamp_ns not in left_out:
            found[one.topic.name].append(one)
    return found


def _compare_topic(rows: _Rows, name: str, recorded: Sequence[TimedMessage], replayed: Sequence[TimedMessage]) -> None:
    pairs = _paired(recorded, replayed)
    unpaired = len(recorded) + len(replayed) - 2 * len(pairs)
    first = next((one for one in (*recorded, *replayed)), None)
    rows.add(name, MESSAGES, float(unpaired), 0 if first is None else first.message.stamp_ns, len(recorded))
    for one, other in pairs:
        for field, apart in deviations(one.message, other.message):
            if field != "seq":  # a recording may begin later than the publisher
                rows.add(name, field, apart, one.message.stamp_ns)


def _paired(
    recorded: Sequence[TimedMessage], replayed: Sequence[TimedMessage]
) -> list[tuple[TimedMessage, TimedMessage]]:
    """Pair messages by order if their numbers are equal, else by stamp."""
    if len(recorded) == len(replayed):
        return list(zip(recorded, replayed, strict=True))
    unpaired: defaultdict[int, list[TimedMessage]] = defaultdict(list)
    for one in replayed:
        unpaired[one.message.stamp_ns].append(one)
    return [(one, found.pop(0)) for one in recorded if (found := unpaired[one.message.stamp_ns])]


def _compare_call(rows: _Rows, call: RecordedCall, outcome: Outcome[Any] | None, left_out: Collection[int]) -> None:
    name, record = call.skill.key, call.answer
    if outcome is None:
        rows.add(name, OUTCOME, math.inf, record.stamp_ns)
        return
    same = (outcome.end, outcome.named_reason) == (record.outcome, record.reason)
    rows.add(name, OUTCOME, 0.0 if same else math.inf, record.stamp_ns)
    if not (same and isinstance(outcome, Succeeded) and record.result):
        return
    if isinstance(outcome.result, Message) and outcome.result.stamp_ns in left_out:
        return
    try:
        result: Any = from_json(record.result.encode(), call.skill.types["return"])
    except CommunicationError:
        if name not in RETURNED_ANOTHER_TYPE:
            rows.add(name, "result", math.inf, record.stamp_ns)
        return
    for field, apart in deviations(result, outcome.result, "result"):
        if field != "result.seq":
            rows.add(name, field, apart, record.stamp_ns)
