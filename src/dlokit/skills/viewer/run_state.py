"""Whether a task waits, runs or pauses, as far as the viewer can know."""

import enum

from dlokit.types.flow import Command, FlowStatus


class RunState(enum.Enum):
    """What the buttons stand for now."""

    WAITING = "waiting"
    RUNNING = "running"
    PAUSED = "paused"
    ENDED = "ended"


def after_status(state: RunState, status: FlowStatus) -> RunState:
    """What a report of the flow says: an outcome is the end; a step runs, unless the operator paused it."""
    if status.outcome is not None:
        return RunState.ENDED
    return RunState.PAUSED if state is RunState.PAUSED else RunState.RUNNING


def after_command(state: RunState, command: Command) -> RunState:
    """What a button does to a running or pausing task; it starts and ends when the flow says so."""
    if command is Command.PAUSE and state is RunState.RUNNING:
        return RunState.PAUSED
    if command in (Command.RESUME, Command.STOP) and state is RunState.PAUSED:
        return RunState.RUNNING
    return state
