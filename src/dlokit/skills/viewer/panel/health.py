"""Whether the components of a run answer, their restarts, and the log of events."""

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from html import escape

from dlokit.communication.transport import Liveness
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.palette import term

LOOK_EVERY_S = 0.5
"""Period of the check whether each component answers [s]; the bus notices a dead process within milliseconds."""


@dataclass(frozen=True, kw_only=True)
class WatchedComponent:
    """A component that the page watches."""

    name: str
    process: str
    """The process that runs it in a live system."""


@dataclass(frozen=True, kw_only=True)
class ComponentHealth:
    """Health of one component."""

    component: WatchedComponent
    alive: bool
    restarts: int
    """Number of times that another process took it over."""


class Health:
    """Checks whether components answer, and reports changes for the log."""

    def __init__(self, components: Iterable[WatchedComponent]) -> None:
        self._components = tuple(components)
        self._servers: dict[str, str] = {}
        self._states: dict[str, ComponentHealth] = {}

    @property
    def states(self) -> tuple[ComponentHealth, ...]:
        """The components that have answered at least once, in the order of the table."""
        return tuple(self._states[each.name] for each in self._components if each.name in self._states)

    @property
    def lost(self) -> tuple[str, ...]:
        """Names of the components that answered before and do not answer now."""
        return tuple(state.component.name for state in self.states if not state.alive)

    def look(self, alive: Callable[[str], Liveness]) -> list[str]:
        """Check all components; returns a sentence for each change."""
        changes: list[str] = []
        for component in self._components:
            changes += self._look(component, alive(component.name))
        return changes

    def _look(self, component: WatchedComponent, now: Liveness) -> list[str]:
        name, before = component.name, self._states.get(component.name)
        if before is None and not now.alive:
            return []  # it has not started yet
        restarts = 0 if before is None else before.restarts
        if now.alive:
            restarts += self._servers.get(name, now.server) != now.server
            self._servers[name] = now.server
        self._states[name] = ComponentHealth(component=component, alive=now.alive, restarts=restarts)
        if before is None or before.alive == now.alive:
            return []
        return [f"{name} (process {component.process}) " + ("answers again" if now.alive else "does not answer")]


class EventLog:
    """The newest events of a run, each with its time."""

    LINES = 200

    def __init__(self, time_text: Callable[[int], str]) -> None:
        """`time_text` formats a stamp on the run's clock [ns] for people."""
        self._time_text = time_text
        self._lines: deque[tuple[str, str]] = deque(maxlen=self.LINES)

    def add(self, text: str, stamp_ns: int) -> None:
        """Note an event, unless it repeats the last one."""
        if text and (not self._lines or self._lines[-1][1] != text):
            self._lines.append((self._time_text(stamp_ns), text))

    def html(self) -> str:
        """The events, the newest first."""
        rows = "".join(
            f'<div><span style="opacity:0.55">{escape(time)}</span> {escape(text)}</div>'
            for time, text in reversed(self._lines)
        )
        return (
            f'<div data-log style="max-height:22em;overflow-y:auto;padding:0 0.8em;font-size:0.75em;line-height:1.5;'
            f'color:{palette.INK};overflow-wrap:anywhere">{rows or "Nothing has happened yet."}</div>'
        )


def health_html(states: Iterable[ComponentHealth]) -> str:
    """A row for each component: whether it answers, its process, its restarts."""
    rows = "".join(
        f'<tr data-component="{escape(state.component.name)}" data-alive="{str(state.alive).lower()}"><td>'
        f'<span style="display:inline-block;width:0.7em;height:0.7em;border-radius:50%;margin-right:0.4em;'
        f'background:{palette.css(palette.ALIVE if state.alive else palette.LOST)}"></span>'
        f"{escape(state.component.name)}</td><td>{escape(state.component.process)}</td>"
        f"<td>{'answers' if state.alive else 'does not answer'}</td>"
        f'<td style="text-align:right">{state.restarts}</td></tr>'
        for state in states
    )
    return (
        f'<table style="width:100%;padding:0 0.8em;font-size:0.8em;color:{palette.INK};text-align:left">'
        f"<tr><th>component</th><th>process</th><th></th><th>{term('restarts')}</th></tr>{rows}</table>"
    )
