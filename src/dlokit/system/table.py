"""The table of processes: who runs where when the system is live, a row each.

The decision process is the one that the user started. It starts the others, which are ready from the top of the table
to the bottom, and stops them the other way round.
"""

import enum
from dataclasses import dataclass


class Needed(enum.Enum):
    """When a process is part of the system."""

    ALWAYS = "always"
    SIMULATED = "when there is no hardware"
    WATCHED = "when somebody watches"
    TWO_ARMS = "when there are two arms"


class TimeBase(enum.Enum):
    """The clock that a process's components wait on."""

    CELL = "the cell's ticks"
    MACHINE = "the machine's monotonic clock"


@dataclass(frozen=True, kw_only=True)
class Restart:
    """How often a process that has died is started again within a window."""

    times: int
    window_s: float
    wait_s: float
    """Before the first time; each further one within the window waits twice as long."""


NEVER = Restart(times=0, window_s=1.0, wait_s=0.0)
AGAIN = Restart(times=3, window_s=120.0, wait_s=0.5)


@dataclass(frozen=True, kw_only=True)
class ProcessRow:
    """One row of the process table."""

    name: str
    components: tuple[str, ...]
    """Names of the components that it runs."""
    after: tuple[str, ...] = ()
    """Processes that must be ready before it is, where they are part of the system."""
    needed: Needed = Needed.ALWAYS
    essential: bool = True
    """Whether the run fails when it is dead for good."""
    restart: Restart = NEVER
    """Only where what its components remember can be told or seen again."""
    time_base: TimeBase = TimeBase.CELL
    ready_within_s: float = 120.0
    """From its start; on a loaded machine imports alone take up to a minute."""
    outlives_s: float = 0.0
    """How long it goes on when the process that has started it is gone without a word [s]."""
    silent_for_s: float = 15.0
    """A process whose event loop gives no heartbeat for so long counts as frozen [s of the machine's clock]."""


# fmt: off
DECISION   = ProcessRow(name="decision",   components=("decision", "planning"))
CELL       = ProcessRow(name="cell",       components=("cell",), needed=Needed.SIMULATED, time_base=TimeBase.MACHINE,
                        outlives_s=2.0)  # the arm, which is in it, brakes in that time
SIMULATION = ProcessRow(name="simulation", components=("model",), restart=AGAIN)
OBSERVER   = ProcessRow(name="observer",   components=("observer",), restart=AGAIN)
ROBOT      = ProcessRow(name="robot",      components=("robot",), after=("cell",))
OPPOSITE   = ProcessRow(name="opposite",   components=("robot.opposite",), after=("cell",), needed=Needed.TWO_ARMS)
CAMERA     = ProcessRow(name="camera",     components=("perception",), after=("cell",), restart=AGAIN)
VIEWER     = ProcessRow(name="viewer", components=("viewer",), needed=Needed.WATCHED, essential=False, restart=AGAIN)
# fmt: on

PROCESSES: tuple[ProcessRow, ...] = (DECISION, CELL, SIMULATION, OBSERVER, ROBOT, OPPOSITE, CAMERA, VIEWER)


def processes_of_run(*, simulated: bool, watched: bool, arms: int = 1) -> tuple[ProcessRow, ...]:
    """The rows that a run needs, the decision process first."""
    wanted = {
        Needed.ALWAYS: True,
        Needed.SIMULATED: simulated,
        Needed.WATCHED: watched,
        Needed.TWO_ARMS: arms == 2,
    }
    return tuple(row for row in PROCESSES if wanted[row.needed])
