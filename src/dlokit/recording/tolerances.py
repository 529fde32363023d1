"""How far a replay may be from its recording: one table, in the fields' own units."""

from dataclasses import dataclass
from fnmatch import fnmatchcase


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """What is allowed of the fields that match, the first that matches counting."""

    what: str
    """Pattern of topics and skills, e.g. ``"perception*"``."""
    field: str
    """Pattern of the field's path, e.g. ``"*.position_m"``."""
    largest: float
    """Largest deviation."""
    why: str
    share: bool = False
    """Whether `largest` is a share of what is compared, and not a deviation."""


_PICTURES = (
    Tolerance(what="perception*", field="*points_world", largest=0.003, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*position_m", largest=0.001, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*wxyz", largest=0.001, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*depth_m", largest=0.003, why="the camera's pose, by pictures kept as JPEG"),
    Tolerance(what="perception.check_camera", field="result.points", largest=50, why="pictures are kept as JPEG"),
    Tolerance(what="perception.check_camera", field="result.*", largest=0.001, why="pictures are kept as JPEG"),
)

SAME_PROCESSOR = (
    *_PICTURES,
    Tolerance(
        what="*",
        field="*",
        largest=1e-9,
        why="recorded with this processor and these versions, where a run repeats to the bit; room for a sum in "
        "another order. What is no number must be equal",
    ),
)
"""For a run in lockstep, whose every message came when it was sent, recorded where calculations round as here."""

TOLERANCES = (
    *_PICTURES,
    Tolerance(
        what="*",
        field="*",
        largest=1e-6,
        why="recorded with another processor or other versions, which round otherwise; a micrometre is a thousand "
        "times what that comes to. What is no number must be equal",
    ),
)
"""For a run in lockstep that was recorded elsewhere."""

LIVE_TOLERANCES = (
    Tolerance(
        what="model/state",
        field="(messages)",
        largest=0.25,
        share=True,
        why="it follows the arm's states, and which of them the model was too late for is not recorded",
    ),
    Tolerance(what="model/belief", field="(messages)", largest=1, why="the first is told before the recorder listens"),
    Tolerance(what="*", field="*stamp_ns", largest=2e8, why="stamps are of a process's own clock"),
    Tolerance(what="model/state", field="nodes_world", largest=0.01, why="the arm moves 5 mm between two states"),
    Tolerance(what="model/state", field="tracking_error_m", largest=0.001, why="as the nodes"),
    Tolerance(what="perception*", field="*pins[[]].position_world", largest=0.01, why="as the model's nodes"),
    Tolerance(what="perception*", field="*depth_m", largest=0.01, why="of the arm, as the model's nodes"),
    Tolerance(what="*", field="*nodes_world", largest=1e-4, why="as tracking_error_m, of one node"),
    Tolerance(what="*", field="*health", largest=0.01, why="fractions of points, of which one may cross a limit"),
    *TOLERANCES,
)
"""For a live run: between two processes a message takes its time, and that is not recorded."""


def tolerance_of(what: str, field: str, *, live: bool, same_processor: bool) -> Tolerance:
    """The row of the table that holds for a field of a topic or skill."""
    lockstep = SAME_PROCESSOR if same_processor else TOLERANCES
    table = LIVE_TOLERANCES if live else lockstep
    return next(row for row in table if fnmatchcase(what, row.what) and fnmatchcase(field, row.field))
