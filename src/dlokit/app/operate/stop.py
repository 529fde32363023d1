"""`dlokit stop`: brake the arms of running systems, keep them stopped and end their tasks, despite other faults."""

import asyncio
import os
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ParamSpec, TypeVar

import tyro

from dlokit.app.commands import CliCommand
from dlokit.app.operate.call import outcome_line
from dlokit.communication.skill import Skill
from dlokit.decision.api import STOP_TASK
from dlokit.description.arm.mounts import INSTANCES, ROBOTS
from dlokit.errors import EXIT_OTHERWISE, DlokitError, InputError
from dlokit.skills.robot import api as robot
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.configuration.toml_config import read_toml
from dlokit.system.processes.bus import JoinBus, calls_published, join_bus
from dlokit.system.processes.first_press import STOP, FirstPress
from dlokit.system.processes.running import (
    RunningSystem,
    is_ending,
    running_systems,
    systems_of,
    the_running_system,
)
from dlokit.system.processes.stop_socket import (
    Answer,
    PressStop,
    answer_on,
    press,
    process_named,
    stop_at_start_file,
    stop_socket,
)
from dlokit.system.table import TimeBase
from dlokit.types.outcome import Outcome, Succeeded

P = ParamSpec("P")
R = TypeVar("R")

FOUND_WITHIN_S = 2.0
STOPPED_WITHIN_S = 15.0
"""Time limit for a whole system [s]; an arm brakes in a fraction of a second."""
STARTS_WITHIN_S = 10.0
"""Time to wait for a robot process that is still starting [s]; after that it starts in the stopped state."""
ENDING = Answer(confirmed=True, text="it is ending, and its task has ended")
_UNREACHABLE = "is unreachable: press the emergency stop of the arm"


@dataclass(frozen=True, kw_only=True)
class StopArgs:
    """Brake the arms of all your running systems now, keep them stopped, and end their tasks.

    These are all systems of your account on this machine, also benches and runs that another person has started under
    it; `--run DIR` stops one. The log and the result of a stopped run name the process that stopped it. An arm stays at
    its position and its gripper keeps its grip until `dlokit enable`. A run that takes goal after goal stays: after
    `dlokit enable` set the next goal on its page; “End run” there or Ctrl-C ends it. The command also works while the
    system starts, and while its decision process is frozen or dead. All systems are stopped in parallel. Exit code: 0
    feedback of every arm shows that it is at rest and the task is ending, 3 something was not confirmed, 2 no system
    runs.
    """

    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Stop only the system of this run folder."""


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """The result for one system."""

    confirmed: bool
    """Whether feedback confirmed that each arm is at rest, and that the task is ending or no task runs."""
    text: str


def run_stop(args: StopArgs, pressed: FirstPress | None = None) -> int:
    """Brake the arms first; end the tasks in parallel.

    `pressed` are the stop sockets that the process has pressed already, before it imported this module.
    """
    pressed = pressed or FirstPress({}, {})
    systems = systems_to_stop(args.run, pressed)
    links = dict(pressed.links)
    if not systems and not links:
        raise InputError("you have no running system: there is nothing to stop.")
    return exit_code(asyncio.run(_run_stop(systems, links)))


def systems_to_stop(run: Path | None, pressed: FirstPress) -> list[RunningSystem]:
    """The systems that run now, and those that ran when their arms were stopped and have ended since.

    Raises `InputError` when `run` is none of them, and no arm of it was stopped either.
    """
    now = running_systems(starting=True)
    known = {(one.pid, one.began_s) for one in now}
    systems = now + [one for one in systems_of(pressed.notes.values()) if (one.pid, one.began_s) not in known]
    if run is None:
        return systems
    chosen = [one for one in systems if one.folder == str(run.resolve())]
    return chosen if chosen or pressed.links else [the_running_system(run, starting=True)]


async def _run_stop(systems: Sequence[RunningSystem], links: dict[Path, socket.socket]) -> list[Stopped]:
    async def press_or_hear(socket: Path, order: bytes, within_s: float, *, starts: bool = False) -> Answer | None:
        link = links.pop(socket, None)
        answer = None if link is None else await answer_on(link, within_s)
        return answer or await press(socket, order, within_s, starts=starts)

    said = await stop_all(systems, say=print, press=press_or_hear)
    for path, link in links.items():  # the decision process was killed, and the robot's process has not ended yet
        arm = path.stem.partition("-")[2]
        answer = await answer_on(link, FOUND_WITHIN_S) or Answer(confirmed=False, text=_UNREACHABLE)
        text = f"the {arm} arm of a run without a decision process {'is at rest' if answer.confirmed else answer.text}"
        print(text)
        said.append(Stopped(confirmed=answer.confirmed, text=text))
    return said


def exit_code(said: Sequence[Stopped]) -> int:
    """0 when every system confirmed everything, 3 otherwise."""
    return 0 if all(stopped.confirmed for stopped in said) else EXIT_OTHERWISE


async def stop_all(
    systems: Sequence[RunningSystem],
    found_within_s: float = FOUND_WITHIN_S,
    stopped_within_s: float = STOPPED_WITHIN_S,
    starts_within_s: float = STARTS_WITHIN_S,
    say: Callable[[str], None] = lambda line: None,
    join: JoinBus = join_bus,
    press: PressStop = press,
    ending: Callable[[RunningSystem], bool] = is_ending,
) -> list[Stopped]:
    """Stop all systems in parallel; no system waits for another, and its lines report its error."""

    reach = _Reach(found_within_s, starts_within_s, join, press, ending)

    async def stopped(system: RunningSystem) -> Stopped:
        lines = list[str]()

        def note(line: str) -> None:
            lines.append(line)
            say(f"{system.folder}: {line}")

        try:
            async with asyncio.timeout(stopped_within_s):
                confirmed = await _stop(system, reach, note)
        except TimeoutError:
            confirmed = False
            note(f"it did not answer within {stopped_within_s:g} s")
        except Exception as error:  # any failure in one system must not keep the arms of the other systems moving
            confirmed = False
            note(f"the request failed: {error}")
        return Stopped(confirmed=confirmed, text="; ".join(lines))

    return await asyncio.gather(*(stopped(system) for system in systems))


@dataclass(frozen=True)
class _Reach:
    """Time limits and transports for reaching the processes of a system."""

    found_within_s: float
    starts_within_s: float
    join: JoinBus
    press: PressStop
    ending: Callable[[RunningSystem], bool]
    """Whether a system stops its processes, or has ended."""


async def _stop(system: RunningSystem, reach: _Reach, note: Callable[[str], None]) -> bool:
    """Stop each arm over the socket of its own process, or over the bus if there is no socket; then end the task.

    Returns whether everything was confirmed. Answers of arms are reported at once, because a frozen decision process
    delays its own.
    """

    async def brake(name: str, instance: str) -> bool:
        try:
            answer = await _brake(system, instance, reach)
        except Exception as error:  # the error of one arm must not end the wait for the other
            answer = Answer(confirmed=False, text=f"{_UNREACHABLE} ({error})")
        if answer.confirmed and reach.ending(system):  # `dlokit enable` will find no arm
            answer = Answer(confirmed=True, text="is at rest")
        note(f"the {name} arm {answer.text}")
        return answer.confirmed

    ending = asyncio.create_task(_end_task(system, reach))
    try:
        braked = await asyncio.gather(*(brake(*arm) for arm in arms_of(Path(system.folder)).items()))
        ended = await ending
    finally:
        ending.cancel()
    note(ended.text)
    return ended.confirmed and all(braked)


async def _brake(system: RunningSystem, instance: str, reach: _Reach) -> Answer:
    socket = stop_socket(Path(system.folder), instance)
    if system.starting:
        stop_at_start_file(socket).touch(mode=0o600)
    within_s = reach.starts_within_s if system.starting else reach.found_within_s
    answer = await reach.press(socket, STOP, within_s, starts=system.starting)
    if answer is not None:
        return answer
    if system.starting:
        return Answer(confirmed=False, text="has not started yet, and will start stopped")
    return await ask_on_bus(system, robot.STOP.at(instance), reach.found_within_s, _UNREACHABLE, reach.join)


async def ask_on_bus(
    system: RunningSystem,
    skill: Skill[[], None],
    found_within_s: float,
    unreachable: str,
    join: JoinBus = join_bus,
) -> Answer:
    """Call a skill of a robot whose process runs on another host, so that it has no socket on this machine."""
    outcome = await _called(system, skill, found_within_s, join)
    if outcome is None:
        return Answer(confirmed=False, text=unreachable)
    return Answer(confirmed=isinstance(outcome, Succeeded), text=outcome_line(outcome))


async def _called(
    system: RunningSystem, skill: Skill[P, R], found_within_s: float, join: JoinBus, *args: P.args, **kwargs: P.kwargs
) -> Outcome[R] | None:
    """The outcome of a call on the bus of a system; None if no process serves the skill."""
    async with join(system.bus, TimeBase.MACHINE) as bus:
        if not await bus.transport.wait_for(skill.component, found_within_s):
            return None
        with calls_published(bus.transport, bus.clock):
            return await bus.transport.call(skill, *args, **kwargs)


async def _end_task(system: RunningSystem, reach: _Reach) -> Answer:
    """End the task as well: it would continue as far as possible without an arm."""
    if system.starting:
        return Answer(confirmed=True, text="it has no task yet")
    if reach.ending(system):
        return ENDING
    try:
        outcome = await _called(system, STOP_TASK, reach.found_within_s, reach.join, process_named(os.getpid()))
    except DlokitError:
        if reach.ending(system):  # its bus has gone meanwhile
            return ENDING
        raise
    match outcome:
        case None if reach.ending(system):
            return ENDING
        case None:
            return Answer(confirmed=False, text="its decision process does not answer, so its task was not ended")
        case Succeeded(result=ran):
            return Answer(confirmed=True, text="its task was stopped" if ran else "it has no task to end")
        case outcome:
            return Answer(confirmed=False, text=f"its task could not be ended: {outcome_line(outcome)}")


def arms_of(folder: Path) -> dict[str, str]:
    """The arms of a run, name → address, according to its configuration; all possible arms if it cannot be read."""
    try:
        run = read_toml(folder / CONFIG_FILE, RunConfig)
    except InputError:
        return dict(zip(ROBOTS, INSTANCES, strict=True))
    return dict(zip(run.installation.robots[: run.arms], INSTANCES, strict=False))


COMMAND = CliCommand(StopArgs, run_stop)
