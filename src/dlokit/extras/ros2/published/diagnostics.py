"""The status of a run and of the link as ROS diagnostics: one level with its reason, one line, and values."""

import enum
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dlokit.extras.ros2.definitions import Definitions
from dlokit.extras.ros2.link.frames import Endpoint, Graph
from dlokit.extras.ros2.published.outgoing import NODE, Published, absolute, header
from dlokit.types.action import Action, kind_of
from dlokit.types.flow import FlowStatus, RunOutcome, RunPhase, RunStatus
from dlokit.types.robot import RobotMode, RobotState


class Level(enum.IntEnum):
    """Levels of a DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Content of a DiagnosticStatus."""

    name: str
    level: Level
    text: str
    """The reason for the level, in one line."""
    values: tuple[tuple[str, str], ...]
    """Keys with their values; a value that is not known is empty."""


def status_message(ros: Definitions, diagnosis: Diagnosis) -> Any:
    """A diagnosis as ``diagnostic_msgs/msg/DiagnosticStatus``."""
    return ros.make(
        "diagnostic_msgs/msg/DiagnosticStatus",
        level=int(diagnosis.level),
        name=diagnosis.name,
        message=diagnosis.text,
        hardware_id="",
        values=[ros.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in diagnosis.values],
    )


def diagnostic_array(ros: Definitions, stamp: int, diagnoses: Iterable[Diagnosis]) -> Any:
    """Diagnoses as ``diagnostic_msgs/msg/DiagnosticArray``."""
    return ros.make(
        "diagnostic_msgs/msg/DiagnosticArray",
        header=header(ros, stamp, ""),
        status=[status_message(ros, diagnosis) for diagnosis in diagnoses],
    )


@dataclass(frozen=True, kw_only=True)
class RunFigures:
    """What is known of the task, from the flow chart, or from its end where the flow chart is not known."""

    step: str = ""
    actions: int = 0
    rmse_m: float | None = None
    outcome: RunOutcome | None = None
    reason: str = ""


def run_figures(flow: FlowStatus | None, run: RunStatus | None) -> RunFigures:
    """The task that runs, or the last one that has ended."""
    if flow is not None:
        return RunFigures(
            step=flow.step, actions=flow.actions, rmse_m=flow.rmse_m, outcome=flow.outcome, reason=_line(flow.text)
        )
    last = None if run is None else run.last
    if last is None:
        return RunFigures()
    return RunFigures(actions=last.actions, rmse_m=last.rmse_m, outcome=last.outcome, reason=_line(last.text))


def run_diagnosis(
    *,
    flow: FlowStatus | None = None,
    run: RunStatus | None = None,
    action: Action | None = None,
    robots: Sequence[RobotState] = (),
    lost: bool = False,
) -> Diagnosis:
    """The status of a run from the newest messages: `action` is the one in progress, `lost` whether the DLO is lost.

    It is an error where a person must act: an arm is stopped or has a fault, or the task failed. It is a warning where
    the task ended without success, or the DLO is lost.
    """
    task = run_figures(flow, run)
    level, text = _level(task, run, robots, lost)
    # While a task runs, the action in progress is counted as well.
    number = task.actions + (task.outcome is None and action is not None)
    return Diagnosis(
        name="dlokit: run",
        level=level,
        text=text,
        values=(
            ("phase", "" if run is None else run.phase.value),
            ("step", task.step),
            ("action", str(number)),
            ("kind", "" if action is None else kind_of(action)),
            ("rmse_m", "" if task.rmse_m is None else f"{task.rmse_m:.6f}"),
            ("outcome", "" if task.outcome is None else task.outcome.value),
            ("reason", task.reason),
            ("stop latched", str(any(robot.stop_latched for robot in robots)).lower()),
        ),
    )


def _level(task: RunFigures, run: RunStatus | None, robots: Sequence[RobotState], lost: bool) -> tuple[Level, str]:
    if stopped := [robot.robot for robot in robots if robot.stop_latched]:
        return Level.ERROR, f"stopped by a person: arm {' and '.join(stopped)}; it moves again once a person enables it"
    if broken := [robot.robot for robot in robots if robot.mode is RobotMode.FAULT]:
        return Level.ERROR, f"arm {' and '.join(broken)} has stopped itself and must recover"
    if task.outcome is not None:
        ended = _spaced(task.outcome.value)
        text = f"{ended}: {task.reason}" if task.reason else f"{ended} after {_counted(task)}"
        failed = Level.ERROR if task.outcome is RunOutcome.FAILED else Level.WARN
        return (Level.OK if task.outcome.is_success else failed), text
    if lost:
        return Level.WARN, "the observer has lost the DLO"
    if run is not None and run.asks:
        return Level.OK, f"waits until the operator allows: {run.asks}"
    if task.step:
        paused = "paused before " if run is not None and run.phase is RunPhase.PAUSED else ""
        return Level.OK, f"{paused}{_spaced(task.step)}, {_counted(task)}"
    return Level.OK, "no task has begun" if run is None else _spaced(run.phase.value)


def _counted(task: RunFigures) -> str:
    actions = "1 action" if task.actions == 1 else f"{task.actions} actions"
    return actions if task.rmse_m is None else f"{actions}, RMSE {task.rmse_m * 1e3:.1f} mm"


def _spaced(name: str) -> str:
    return name.replace("_", " ")


def _line(text: str) -> str:
    return " ".join(text.split())


@dataclass(frozen=True, kw_only=True)
class LinkFacts:
    """What the process that serves the link knows of it."""

    graph: Graph | None = None
    """The last graph that the node has sent; None before the first."""
    dropped: int = 0
    """Number of messages that one side of the link has dropped because the other did not read them in time."""
    clock_offset_ns: int | None = None
    """ROS time minus the machine's wall clock [ns]; None before it is known."""
    lacks: Mapping[str, str] = field(default_factory=dict[str, str])
    """Why the node cannot publish or subscribe to a topic, by topic."""


def link_diagnosis(facts: LinkFacts, rows: Sequence[Published], node: str = NODE) -> Diagnosis:
    """The status of the link: readers that ask for what is not offered, dropped messages, the offset of the clocks.

    It is a warning where a reader gets nothing, messages were dropped, or the node lacks a topic. A reader that only
    may lose messages is named in the values. The offset is none: a node may follow the time of a simulation. `node` is
    the full name of the node.
    """
    silent, lossy = _readers(facts.graph, rows, node)
    problems = [f"{reader} gets nothing" for reader, _ in silent]
    problems += [f"{topic}: {why}" for topic, why in facts.lacks.items()]
    if facts.dropped:
        problems.append(f"{facts.dropped} messages were dropped on the link, which is too slow")
    return Diagnosis(
        name="dlokit: link",
        level=Level.WARN if problems else Level.OK,
        text="; ".join(problems) or ("waits for the node" if facts.graph is None else "the node is connected"),
        values=(
            ("clock offset s", "" if facts.clock_offset_ns is None else f"{facts.clock_offset_ns / 1e9:.6f}"),
            ("dropped", str(facts.dropped)),
            *((f"reader {reader}", what) for reader, what in (*silent, *lossy)),
            *((f"lacks {topic}", why) for topic, why in facts.lacks.items()),
        ),
    )


_Named = list[tuple[str, str]]


def _readers(graph: Graph | None, rows: Sequence[Published], node: str) -> tuple[_Named, _Named]:
    """Readers that get nothing, and readers that may lose messages, each with the reason."""
    silent, lossy = _Named(), _Named()
    for row in rows:
        for reader in () if graph is None else graph.subscriptions.get(row.topic, ()):
            place = f"{reader.node} on {absolute(row.topic, node)}"
            if why := _why_silent(reader, row):
                silent.append((place, why))
            elif why := _why_lossy(reader, row):
                lossy.append((place, why))
    return silent, lossy


def _why_silent(reader: Endpoint, row: Published) -> str:
    if reader.type != row.kind:
        return f"gets nothing: it reads {reader.type}, and {row.kind} is published"
    if reader.transient_local and not row.transient_local:
        return "gets nothing: it asks for durability transient local, and volatile is offered"
    return ""


def _why_lossy(reader: Endpoint, row: Published) -> str:
    if not reader.reliable:
        return "may lose messages: it asks for reliability best effort, and reliable is offered"
    if row.transient_local and not reader.transient_local:
        return "gets no message before the next: it asks for durability volatile, and transient local is offered"
    return ""
