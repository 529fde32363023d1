"""The tables of the system: one row per component, and one row per process that runs components in a live system.

The user starts the decision process. It starts the other processes, which become ready in the order of the table, and
stops them in reverse order. Reading the table imports no component. Other packages add components by entry points
`dlokit.components`, each in its own process or in one of dlokit's.
"""

import enum
import logging
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from dlokit.communication.skill import Skill
from dlokit.communication.strategies import rows_from_packages
from dlokit.errors import CELL_MODULES, ConfigError

if TYPE_CHECKING:
    from dlokit.communication.component import Component
    from dlokit.system.config import RunConfig

log = logging.getLogger(__name__)


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


def always(run: "RunConfig") -> bool:
    """In every run."""
    return True


def in_cell(run: "RunConfig") -> bool:
    """In runs whose hardware is simulated."""
    return run.has_cell


def watched(run: "RunConfig") -> bool:
    """In runs with the viewer."""
    return not run.headless


def with_two_arms(run: "RunConfig") -> bool:
    """In runs with two arms."""
    return run.arms == 2


def nothing_to_check(run: "RunConfig") -> None:
    """For components that need nothing outside the run."""


@dataclass(frozen=True, kw_only=True)
class ComponentRow:
    """One row of the table of components."""

    name: str
    """Name of the component; a second instance has its own, e.g. `robot.second`."""
    kind: str
    """Its class as `module:Class`, imported only where it runs."""
    api: str = ""
    """The module that declares its skills; empty: it has none."""
    settings: str = ""
    """Its section of the configuration, from which it is built; empty: it is built from the whole configuration."""
    process: str | ProcessRow
    """The process that runs it in a live system; other packages may give one of their own."""
    when: Callable[["RunConfig"], bool] = always
    """Whether it is part of a run; the process is part of those that need one of its components."""
    check: Callable[["RunConfig"], None] = nothing_to_check
    """Raises `InputError` before a run starts in which it could not work."""
    tracks: bool = False
    """Whether `dlokit track` also runs it, in its own process: it needs no robot."""
    replays: tuple[str, ...] = ()
    """Sections of the configuration that it is built from when `dlokit replay` feeds it a recorded run. Empty: its
    outputs do not follow from recorded messages and calls, because a recording lacks the calls of drivers to the cell,
    some answers to the decision layer, and the inputs of an operator."""

    def __post_init__(self) -> None:
        if not callable(self.when) or not re.fullmatch(r"[\w.]+:\w+", self.kind):
            raise ConfigError(
                f"component {self.name}: kind is {self.kind!r} and when is {self.when!r}; kind must be module:Class, "
                "and when a function of a run's configuration."
            )

    @property
    def process_name(self) -> str:
        """Name of its process."""
        return self.process if isinstance(self.process, str) else self.process.name

    def skills(self) -> tuple[Skill[..., Any], ...]:
        """Its skills."""
        if not self.api:
            return ()
        return tuple(value for value in vars(import_module(self.api)).values() if isinstance(value, Skill))

    def load(self) -> "type[Component]":
        """Import and return its class. Raises `ConfigError` when it cannot be found."""
        module, _, name = self.kind.partition(":")
        try:
            loaded: type[Component] = getattr(import_module(module), name)
        except (ModuleNotFoundError, AttributeError) as error:
            if error.name in CELL_MODULES:  # of a plain installation
                raise
            raise ConfigError(f"component {self.name} cannot be loaded from {self.kind}: {error}.") from error
        return loaded


# fmt: off
COMPONENTS: dict[str, ComponentRow] = {row.name: row for row in (
    ComponentRow(name="cell",       kind="dlokit.functional.cell.component:CellComponent",
                 api="dlokit.functional.cell.api",   settings="cell",       process="cell", when=in_cell),
    ComponentRow(name="robot",      kind="dlokit.skills.robot.component:RobotComponent",
                 api="dlokit.skills.robot.api",      settings="robot",      process="robot"),
    ComponentRow(name="robot.second", kind="dlokit.skills.robot.component:RobotComponent",
                 api="dlokit.skills.robot.api",      settings="robot",      process="second", when=with_two_arms),
    ComponentRow(name="perception", kind="dlokit.skills.perception.component:PerceptionComponent",
                 api="dlokit.skills.perception.api", settings="perception", process="camera",
                 replays=("perception",)),
    ComponentRow(name="observer",   kind="dlokit.skills.observer.component:ObserverComponent",
                 api="dlokit.skills.observer.api",   settings="observer",   process="observer",
                 replays=("observer", "model")),
    ComponentRow(name="model",      kind="dlokit.skills.model.component:ModelComponent",
                 api="dlokit.skills.model.api",      settings="model",      process="simulation",
                 replays=("model",)),
    ComponentRow(name="planning",   kind="dlokit.skills.planning.component:PlanningComponent",
                 api="dlokit.skills.planning.api",   settings="planning",   process="decision",
                 replays=("planning", "model")),
    ComponentRow(name="viewer",     kind="dlokit.skills.viewer.component:ViewerComponent",
                 settings="viewer",     process="viewer", when=watched),
    ComponentRow(name="decision",   kind="dlokit.decision.component:DecisionComponent",
                 api="dlokit.decision.api",          settings="task",       process="decision"),
)}
# fmt: on
"""dlokit's components by name: the components of the paper's Fig. 3, and the cell that simulates its hardware."""


def _in(process: str) -> tuple[str, ...]:
    return tuple(row.name for row in COMPONENTS.values() if row.process == process)


# fmt: off
DECISION   = ProcessRow(name="decision",   components=_in("decision"))
CELL       = ProcessRow(name="cell",       components=_in("cell"), time_base=TimeBase.MACHINE,
                        outlives_s=2.0)  # its arm brakes within that time
SIMULATION = ProcessRow(name="simulation", components=_in("simulation"), restart=AGAIN)
OBSERVER   = ProcessRow(name="observer",   components=_in("observer"), restart=AGAIN)
ROBOT      = ProcessRow(name="robot",      components=_in("robot"), after=("cell",))
SECOND     = ProcessRow(name="second",     components=_in("second"), after=("cell",))
CAMERA     = ProcessRow(name="camera",     components=_in("camera"), after=("cell",), restart=AGAIN)
VIEWER     = ProcessRow(name="viewer", components=_in("viewer"), essential=False, restart=AGAIN)
# fmt: on

PROCESSES: tuple[ProcessRow, ...] = (DECISION, CELL, SIMULATION, OBSERVER, ROBOT, SECOND, CAMERA, VIEWER)


@cache
def component_table() -> dict[str, ComponentRow]:
    """All components by name: first dlokit's, then those that packages add by entry points `dlokit.components`."""
    table, ours = dict(COMPONENTS), {row.name for row in PROCESSES}
    for row in rows_from_packages("dlokit.components", ComponentRow, COMPONENTS):
        if (row.process_name in ours) == isinstance(row.process, str):
            table[row.name] = row
        else:
            said = "skipped: component %s: its process %r must be the name of one of dlokit's, %s, or another's row"
            log.warning(said, row.name, row.process_name, ", ".join(sorted(ours)))
    return table


@cache
def process_table() -> tuple[ProcessRow, ...]:
    """All processes of live systems; processes that other packages add are last."""
    rows = {row.name: row for row in PROCESSES}
    for component in component_table().values():
        if component.name in COMPONENTS:
            continue
        if isinstance(component.process, ProcessRow):
            rows.setdefault(component.process.name, replace(component.process, components=()))
        row = rows[component.process_name]
        rows[row.name] = replace(row, components=(*row.components, component.name))
    return tuple(rows.values())


def components_of_run(run: "RunConfig") -> tuple[str, ...]:
    """The names of the components that a run needs."""
    return tuple(row.name for row in component_table().values() if row.when(run))


def trackers_of_run(run: "RunConfig") -> tuple[ComponentRow, ...]:
    """The components that `dlokit track` runs."""
    return tuple(row for row in component_table().values() if row.tracks and row.when(run))


def instances_of_run(run: "RunConfig") -> dict[str, tuple[str, ...]]:
    """Instances in a run in addition to the first, by component."""
    found: dict[str, tuple[str, ...]] = {}
    for name in components_of_run(run):
        kind, dot, instance = name.partition(".")
        if dot:
            found[kind] = (*found.get(kind, ()), instance)
    return found


def processes_of_run(run: "RunConfig") -> tuple[ProcessRow, ...]:
    """The processes of a live run, the decision process first, each with the components that the run needs.

    Without the cell, and when the cell's arm mirrors a driver's arm, all follow the machine's clock.
    """
    needed = components_of_run(run)
    found: list[ProcessRow] = []
    for row in process_table():
        if components := tuple(name for name in row.components if name in needed):
            time_base = row.time_base if run.has_cell and not run.mirrors_arm else TimeBase.MACHINE
            found.append(replace(row, components=components, time_base=time_base))
    return tuple(found)
