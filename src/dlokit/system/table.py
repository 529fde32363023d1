"""The tables of the system: one row per component, and one row per process that runs components in a live system.

The user starts the decision process. It starts the others, which become ready in the order of the table, and stops them
in reverse order. Reading the table imports no component.
"""

import enum
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

from dlokit.communication.skill import Skill

if TYPE_CHECKING:
    from dlokit.communication.component import Component


@dataclass(frozen=True, kw_only=True)
class ComponentRow:
    """One row of the table of components."""

    name: str
    """Name of the component; a second instance has its own, e.g. `robot.second`."""
    kind: str
    """Its class as `module:Class` below `dlokit`, imported only where it runs."""
    api: str = ""
    """The module below `dlokit` that declares its skills; empty: it has none."""
    settings: str
    """Its section of the configuration."""
    process: str
    """The process that runs it in a live system."""
    replays: tuple[str, ...] = ()
    """Sections of the configuration that it is built from when `dlokit replay` feeds it a recorded run. Empty: its
    outputs do not follow from recorded messages and calls, because a recording lacks the calls of drivers to the cell,
    some answers to the decision layer, and the inputs of an operator."""

    def skills(self) -> tuple[Skill[..., Any], ...]:
        """Its skills."""
        if not self.api:
            return ()
        return tuple(value for value in vars(import_module(f"dlokit.{self.api}")).values() if isinstance(value, Skill))

    def load(self) -> "type[Component]":
        """Import and return its class."""
        module, _, name = self.kind.partition(":")
        loaded: type[Component] = getattr(import_module(f"dlokit.{module}"), name)
        return loaded


# fmt: off
COMPONENTS: dict[str, ComponentRow] = {row.name: row for row in (
    ComponentRow(name="cell",       kind="functional.cell.component:CellComponent",         api="functional.cell.api",
                 settings="cell",       process="cell"),
    ComponentRow(name="robot",      kind="skills.robot.component:RobotComponent",           api="skills.robot.api",
                 settings="robot",      process="robot"),
    ComponentRow(name="robot.second", kind="skills.robot.component:RobotComponent",         api="skills.robot.api",
                 settings="robot",      process="second"),
    ComponentRow(name="perception", kind="skills.perception.component:PerceptionComponent", api="skills.perception.api",
                 settings="perception", process="camera",      replays=("perception",)),
    ComponentRow(name="observer",   kind="skills.observer.component:ObserverComponent",     api="skills.observer.api",
                 settings="observer",   process="observer",    replays=("observer", "model")),
    ComponentRow(name="model",      kind="skills.model.component:ModelComponent",           api="skills.model.api",
                 settings="model",      process="simulation",  replays=("model",)),
    ComponentRow(name="planning",   kind="skills.planning.component:PlanningComponent",     api="skills.planning.api",
                 settings="planning",   process="decision",    replays=("planning", "model")),
    ComponentRow(name="viewer",     kind="skills.viewer.component:ViewerComponent",
                 settings="viewer",     process="viewer"),
    ComponentRow(name="decision",   kind="decision.component:DecisionComponent",            api="decision.api",
                 settings="task",       process="decision"),
)}
# fmt: on
"""All components by name: those of the paper's Fig. 3, and the cell that simulates its hardware."""


class Needed(enum.Enum):
    """Condition under which a process is part of the system."""

    ALWAYS = "always"
    SIMULATED = "when there is no hardware"
    WATCHED = "when somebody watches"
    TWO_ARMS = "when there are two arms"


class TimeBase(enum.Enum):
    """The clock of a process's components."""

    CELL = "the cell's ticks"
    MACHINE = "the machine's monotonic clock"
    SHARED = "the machine's monotonic clock, whose ticks the processes of other machines follow in place of a cell's"


@dataclass(frozen=True, kw_only=True)
class Restart:
    """Restart policy: the maximum number of restarts within a window."""

    times: int
    window_s: float
    wait_s: float
    """Delay before the first restart [s]; it doubles with each further restart within the window."""


NEVER = Restart(times=0, window_s=1.0, wait_s=0.0)
AGAIN = Restart(times=3, window_s=120.0, wait_s=0.5)


@dataclass(frozen=True, kw_only=True)
class ProcessRow:
    """One row of the process table."""

    name: str
    components: tuple[str, ...]
    """Names of its components."""
    after: tuple[str, ...] = ()
    """Processes that must be ready first, if they are part of the system."""
    needed: Needed = Needed.ALWAYS
    essential: bool = True
    """Whether the run fails when it has failed permanently."""
    restart: Restart = NEVER
    """A restart is allowed only if the state of its components can be restored from messages or observations."""
    time_base: TimeBase = TimeBase.CELL
    ready_within_s: float = 120.0
    """Longest time without a sign of life during its start [s]; on a loaded machine imports take up to a minute."""
    outlives_s: float = 0.0
    """Time for which it continues after its parent process has died [s]."""
    silent_for_s: float = 15.0
    """A process whose event loop sends no heartbeat for this long counts as frozen, in wall time [s]."""


def _in(process: str) -> tuple[str, ...]:
    return tuple(row.name for row in COMPONENTS.values() if row.process == process)


# fmt: off
DECISION   = ProcessRow(name="decision",   components=_in("decision"))
CELL       = ProcessRow(name="cell",       components=_in("cell"), needed=Needed.SIMULATED, time_base=TimeBase.MACHINE,
                        outlives_s=2.0)  # its arm brakes within that time
SIMULATION = ProcessRow(name="simulation", components=_in("simulation"), restart=AGAIN)
OBSERVER   = ProcessRow(name="observer",   components=_in("observer"), restart=AGAIN)
ROBOT      = ProcessRow(name="robot",      components=_in("robot"), after=("cell",))
SECOND     = ProcessRow(name="second",     components=_in("second"), after=("cell",), needed=Needed.TWO_ARMS)
CAMERA     = ProcessRow(name="camera",     components=_in("camera"), after=("cell",), restart=AGAIN)
VIEWER     = ProcessRow(name="viewer", components=_in("viewer"), needed=Needed.WATCHED, essential=False, restart=AGAIN)
# fmt: on

PROCESSES: tuple[ProcessRow, ...] = (DECISION, CELL, SIMULATION, OBSERVER, ROBOT, SECOND, CAMERA, VIEWER)


def processes_of_run(*, simulated: bool, watched: bool, arms: int = 1, mirrors: bool = False) -> tuple[ProcessRow, ...]:
    """The rows that a run needs, the decision process first.

    Without the cell, and where the cell's arm mirrors that of a driver, all follow the machine's clock.
    """
    wanted = {
        Needed.ALWAYS: True,
        Needed.SIMULATED: simulated,
        Needed.WATCHED: watched,
        Needed.TWO_ARMS: arms == 2,
    }
    rows = tuple(row for row in PROCESSES if wanted[row.needed])
    return rows if simulated and not mirrors else tuple(replace(row, time_base=TimeBase.MACHINE) for row in rows)
