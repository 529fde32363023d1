"""The reports of a commander: what it tries is known, also when the commander is killed meanwhile."""

import asyncio
import multiprocessing

from dlokit.bench.stop.logs import Attempt, AttemptLog, outcome_name
from dlokit.types.outcome import Cancelled, Failed, Rejected

PATIENCE_S = 10.0
BEGUN = Attempt(skill="robot.grasp", began_s=1.0)
ENDED = Attempt(skill="robot.grasp", began_s=1.0, ended_s=2.0, ended_as="Succeeded")


def test_an_attempt_runs_from_its_first_report_to_its_second() -> None:
    async def body() -> None:
        reports, sender = multiprocessing.Pipe(duplex=False)
        log = AttemptLog()
        log.listen(reports)
        sender.send(BEGUN)
        assert await log.until(lambda: log.running == "robot.grasp", PATIENCE_S)
        sender.send(ENDED)
        assert await log.until(lambda: log.running == "", PATIENCE_S)
        assert log.between(1.0, 2.0) == [ENDED]
        assert log.between(1.5, 3.0) == []  # it began before
        assert log.between(0.0, 1.5) == []  # it ended after
        log.close()
        sender.close()

    asyncio.run(body())


def test_nothing_runs_any_more_when_the_commander_is_gone() -> None:
    async def body() -> None:
        reports, sender = multiprocessing.Pipe(duplex=False)
        log = AttemptLog()
        log.listen(reports)
        sender.send(BEGUN)
        sender.close()
        await asyncio.sleep(0)
        assert await log.until(lambda: log.running == "", PATIENCE_S)
        assert not await log.until(lambda: False, 0.01)

    asyncio.run(body())


def test_an_outcome_is_named_with_its_reason() -> None:
    assert outcome_name(Rejected(reason="stop_latched")) == "Rejected stop_latched"
    assert outcome_name(Failed(reason="stopped")) == "Failed stopped"
    assert outcome_name(Cancelled()) == "Cancelled"
