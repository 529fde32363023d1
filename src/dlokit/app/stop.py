"""`dlokit stop`: the arms of running systems brake, and their tasks end, whatever else is wrong."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app.call import in_words
from dlokit.app.command import Command
from dlokit.decision.api import STOP_TASK
from dlokit.description.arms import ARMS, ArmMount
from dlokit.errors import InputError
from dlokit.skills.robot import api as robot
from dlokit.system.config import CONFIG_FILE, RunConfig
from dlokit.system.joined_bus import JoinedBus, join_bus
from dlokit.system.processes import TimeBase
from dlokit.system.recording import with_calls_told
from dlokit.system.running import RunningSystem, running_systems, the_running_system
from dlokit.system.toml_config import read_toml
from dlokit.types.outcome import Outcome, Succeeded, Unreachable

EXIT_ALL_STAND = 0
EXIT_NOT_ALL = 3
FOUND_WITHIN_S = 5.0
STOPPED_WITHIN_S = 15.0
"""A system is waited for so long in all; an arm brakes in a fraction of a second."""


@dataclass(frozen=True, kw_only=True)
class StopArgs:
    """Brake the arms of every running system of yours, now, and end their tasks.

    An arm stays where it is and holds what it holds. All systems are stopped at once, and each is told of. Exit code:
    0 every arm stands, 3 one of them did not say so, 2 no system runs.
    """

    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Only the system of this run's folder."""


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """What became of one system."""

    stands: bool
    """Whether each of its arms said that it stands."""
    text: str


def run_stop(args: StopArgs) -> int:
    """Brake first, ask afterwards."""
    systems = running_systems() if args.run is None else [the_running_system(args.run)]
    if not systems:
        raise InputError("no system of yours runs: there is nothing to stop.")
    said = asyncio.run(stop_all(systems))
    for system, stopped in zip(systems, said, strict=True):
        print(f"{system.folder}: {stopped.text}")
    return EXIT_ALL_STAND if all(stopped.stands for stopped in said) else EXIT_NOT_ALL


async def stop_all(
    systems: Sequence[RunningSystem], found_within_s: float = FOUND_WITHIN_S, stopped_within_s: float = STOPPED_WITHIN_S
) -> list[Stopped]:
    """Stop all of them at once; none waits for another, and what is wrong with one is told in its line."""

    async def stopped(system: RunningSystem) -> Stopped:
        try:
            async with asyncio.timeout(stopped_within_s):
                return await _stop(system, found_within_s)
        except TimeoutError:
            return Stopped(stands=False, text=f"it did not answer within {stopped_within_s:g} s")
        except Exception as error:  # whatever is wrong with one system, the arms of the others must brake
            return Stopped(stands=False, text=f"it could not be asked: {error}")

    return await asyncio.gather(*(stopped(system) for system in systems))


async def _stop(system: RunningSystem, found_within_s: float) -> Stopped:
    arms = _arms(Path(system.folder))
    async with join_bus(system.bus, TimeBase.MACHINE) as bus, asyncio.TaskGroup() as group:
        brakes = [group.create_task(_brake(bus, mount, found_within_s)) for mount in arms]
        ending = group.create_task(_end_task(bus, found_within_s))
    outcomes = [brake.result() for brake in brakes]
    words = [f"{mount.robot} {in_words(outcome)}" for mount, outcome in zip(arms, outcomes, strict=True)]
    return Stopped(
        stands=all(isinstance(outcome, Succeeded) for outcome in outcomes),
        text="; ".join((*words, ending.result())),
    )


async def _brake(bus: JoinedBus, mount: ArmMount, found_within_s: float) -> Outcome[None]:
    skill = robot.STOP.at(mount.instance)
    if not await bus.transport.wait_for(skill.component, found_within_s):
        return Unreachable(component=skill.component)
    return await with_calls_told(bus.transport, bus.clock).call(skill)


async def _end_task(bus: JoinedBus, found_within_s: float) -> str:
    """An arm that stands between two motions would go on with the next: so the task ends as well; said in words."""
    if not await bus.transport.wait_for(STOP_TASK.component, found_within_s):
        return "it has no task to end"
    match await with_calls_told(bus.transport, bus.clock).call(STOP_TASK):
        case Succeeded(result=ran):
            return "its task is told to end" if ran else "it has no task to end"
        case outcome:
            return f"its task could not be told to end: {in_words(outcome)}"


def _arms(folder: Path) -> tuple[ArmMount, ...]:
    """The arms of a run, by its configuration; all that there may be where that cannot be read."""
    try:
        return ARMS[: read_toml(folder / CONFIG_FILE, RunConfig).arms]
    except InputError:
        return ARMS


COMMAND = Command(StopArgs, run_stop)
