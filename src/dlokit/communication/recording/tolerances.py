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


_EXACT = Tolerance(
    what="*",
    field="*",
    largest=1e-6,
    why="equal on one machine to the bit; another one may round otherwise. What is no number must be equal",
)

TOLERANCES = (
    Tolerance(what="perception*", field="*points_world", largest=0.003, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*position_m", largest=0.001, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*wxyz", largest=0.001, why="pictures are kept as JPEG"),
    Tolerance(what="perception*", field="*depth_m", largest=0.003, why="the camera's pose, by pictures kept as JPEG"),
    Tolerance(what="perception.check_camera", field="result.points", largest=50, why="pictures are kept as JPEG"),
    Tolerance(what="perception.check_camera", field="result.*", largest=0.001, why="pictures are kept as JPEG"),
    Tolerance(what="*", field="*nodes_world", largest=1e-4, why="iterations end at a tolerance of their own"),
    Tolerance(what="*", field="*health", largest=0.01, why="shares of points, of which one may cross a limit"),
    _EXACT,
)
"""For a run in lockstep, whose every message came when it was sent."""

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
    *TOLERANCES,
)
"""For a live run: between two processes a message takes its time, and that is not recorded."""


def tolerance_of(what: str, field: str, *, live: bool) -> Tolerance:
    """The row of the table that holds for a field of a topic or skill."""
    table = LIVE_TOLERANCES if live else TOLERANCES
    return next(row for row in table if fnmatchcase(what, row.what) and fnmatchcase(field, row.field))
