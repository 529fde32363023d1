"""Tolerances between a replay and its recording, as a table in the units of the fields."""

import math
from dataclasses import dataclass
from fnmatch import fnmatchcase


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
    Tolerance(what="perception.check_camera", field="result.points", largest=50, why="images are recorded as JPEG"),
    Tolerance(what="perception.check_camera", field="result.*", largest=0.001, why="images are recorded as JPEG"),
)

_NAMES = (
    Tolerance(
        what="planning*",
        field="*robot",
        largest=math.inf,
        why="the name of an arm is the installation's, and was another one in older recordings",
    ),
)

SAME_PROCESSOR = (
    *_PICTURES,
    *_NAMES,
    Tolerance(
        what="*",
        field="*",
        largest=1e-9,
        why="recorded with this processor and these versions, where runs are identical to the bit; allows for sums in "
        "another order. Values that are not numbers must be equal",
    ),
)
"""For a lockstep run, where messages arrive when they are sent, recorded on a machine that rounds as this one."""

TOLERANCES = (
    *_PICTURES,
    *_NAMES,
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
