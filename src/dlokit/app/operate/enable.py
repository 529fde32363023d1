"""`dlokit enable`: allow arms to move again after an operator's stop."""

import asyncio
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dlokit.app.commands import CliCommand
from dlokit.app.operate.stop import FOUND_WITHIN_S, arms_of, ask_on_bus
from dlokit.errors import EXIT_OTHERWISE
from dlokit.skills.robot import api as robot
from dlokit.system.processes.running import RunningSystem, the_running_system
from dlokit.system.processes.stop_socket import ENABLE, Answer, press, stop_socket


@dataclass(frozen=True, kw_only=True)
class EnableArgs:
    """Allow the arms of a running system to move again after an operator's stop.

    Check first that no person is within reach of the arms, and that the DLO is free. Nothing moves immediately; the
    arms move with the next task or motion command. Exit code: 0 every arm is enabled, 3 one is not, 2 no system runs.
    """

    run: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder of the run, needed when several systems run."""


def run_enable(args: EnableArgs) -> int:
    """Enable every arm of one system."""
    system = the_running_system(args.run, starting=True)
    arms = arms_of(Path(system.folder))
    answers = asyncio.run(enable_all(system, arms.values()))
    for arm, answer in zip(arms, answers, strict=True):
        print(f"the {arm} arm {answer.text}")
    return exit_code(answers)


def exit_code(answers: Sequence[Answer]) -> int:
    """0 when every arm is enabled, 3 otherwise."""
    return 0 if all(answer.confirmed for answer in answers) else EXIT_OTHERWISE


async def enable_all(system: RunningSystem, instances: Iterable[str]) -> list[Answer]:
    """Enable the arms of one system, one after the other, and return their answers."""
    return [await _enable(system, instance) for instance in instances]


async def _enable(system: RunningSystem, instance: str) -> Answer:
    answer = await press(stop_socket(Path(system.folder), instance), ENABLE, FOUND_WITHIN_S)
    if answer is not None:
        return answer
    unreachable = "is unreachable: check with dlokit ps that its process runs"
    return await ask_on_bus(system, robot.ENABLE.at(instance), FOUND_WITHIN_S, unreachable)


COMMAND = CliCommand(EnableArgs, run_enable)
