import asyncio

from dlokit.decision.operator import OperatorDesk
from dlokit.types.flow import Command, RunPhase, RunStatus


def _passes(desk: OperatorDesk, motion: str, *commands: Command) -> tuple[bool, list[RunPhase]]:
    """Whether the flow passes such a step by itself, and the phases until it has passed after `commands`."""
    phases: list[RunPhase] = []

    async def scenario() -> bool:
        passing = asyncio.create_task(desk.gate(motion))
        await asyncio.sleep(0)
        at_once = passing.done()
        phases.append(desk.status.phase)
        for command in commands:
            desk.command(command)
            await asyncio.sleep(0)
            await asyncio.sleep(0)
            phases.append(desk.status.phase)
        passing.cancel()
        return at_once

    return asyncio.run(scenario()), phases


def _desk(*commands: Command) -> OperatorDesk:
    desk = OperatorDesk(lambda status: None)
    for command in commands:
        desk.command(command)
    return desk


def test_a_paused_task_is_held_at_its_next_step_until_it_is_resumed() -> None:
    assert _passes(_desk(), "") == (True, [RunPhase.RUNNING])
    held = _passes(_desk(Command.PAUSE), "", Command.PROCEED, Command.RESUME)
    assert held == (False, [RunPhase.PAUSED, RunPhase.PAUSED, RunPhase.RUNNING])


def test_step_by_step_each_motion_waits_for_the_operator_and_nothing_else_does() -> None:
    assert _passes(_desk(Command.STEPWISE), "") == (True, [RunPhase.RUNNING])
    assert _passes(_desk(Command.STEPWISE), "move above", Command.PROCEED) == (
        False,
        [RunPhase.ASKING, RunPhase.RUNNING],
    )
    assert _passes(_desk(Command.STEPWISE), "close the fingers", Command.CONTINUOUS)[1] == [
        RunPhase.ASKING,
        RunPhase.RUNNING,
    ]


def test_a_yes_allows_one_motion() -> None:
    async def scenario() -> bool:
        desk = _desk(Command.STEPWISE)
        first = asyncio.create_task(desk.gate("move above"))
        await asyncio.sleep(0)
        desk.command(Command.PROCEED)
        await first
        second = asyncio.create_task(desk.gate("close the fingers"))
        await asyncio.sleep(0)
        held = not second.done()
        second.cancel()
        return held

    assert asyncio.run(scenario())


def test_a_yes_before_the_question_allows_nothing() -> None:
    assert not _passes(_desk(Command.STEPWISE, Command.PROCEED), "move above")[0]


def test_each_change_is_published_once_and_a_task_begins_without_the_pause_of_the_last() -> None:
    published: list[RunStatus] = []
    desk = OperatorDesk(published.append)
    desk.command(Command.PAUSE)
    desk.command(Command.PAUSE)
    desk.publish(RunPhase.WAITING)
    desk.publish(RunPhase.WAITING)
    desk.task_begins()
    seen = [(status.phase, status.paused, status.task) for status in published]
    assert seen == [(RunPhase.STARTING, True, 0), (RunPhase.WAITING, True, 0), (RunPhase.RUNNING, False, 1)]
