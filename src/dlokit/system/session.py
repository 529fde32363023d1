"""A run that takes one goal after another from its operator, common to both runtimes."""

import asyncio
from dataclasses import replace

from dlokit.communication.timing.clock import Clock
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_record import RunRecord
from dlokit.system.shaping import Stop, Watcher, shape
from dlokit.types.flow import OperatorCommand, RunOutcome, RunPhase


async def shape_until_ended(
    decision: DecisionComponent,
    transport: Transport,
    clock: Clock,
    config: RunConfig,
    job: ShapeJob,
    watch: Watcher,
    stop: Stop | None = None,
) -> RunRecord:
    """Run the task of `job`, then one for each start of the operator, until they end the run; the last record.

    `stop` is that of `shape`. Cancelling it ends the running task with outcome `cancelled`, and the run.
    """
    current = asyncio.current_task()
    assert current is not None
    decision.desk.stay()
    number = 1
    while True:
        record = await shape(decision, transport, clock, config, job, watch, stop)
        if current.cancelling():
            decision.desk.end()
        keeping = asyncio.ensure_future(watch.ended(number, record))
        try:
            end = await asyncio.shield(keeping)
        except asyncio.CancelledError:  # Ctrl-C while the files of the task are written: they are, and the run ends
            decision.desk.end()
            end = await keeping
        decision.desk.publish(RunPhase.FINISHING, last=end)
        stopped = record.result.outcome in _LEFT_AS_THEY_WERE
        start = await _next_start(decision, takes_over=stopped)
        if start is None:
            decision.desk.publish(RunPhase.ENDED)
            return record
        number += 1
        job = replace(job, request=None, shown=False, start=start, takes_over=stopped)


_LEFT_AS_THEY_WERE = frozenset({RunOutcome.CANCELLED, RunOutcome.FAILED})
"""Outcomes after which the arms are where they were, perhaps with the DLO in their fingers."""


async def _next_start(decision: DecisionComponent, *, takes_over: bool) -> OperatorCommand | None:
    """The operator's next start; None where the run ends instead."""
    if decision.desk.ends.is_set():
        return None
    try:
        return await decision.next_start(takes_over=takes_over)
    except asyncio.CancelledError:  # Ctrl-C between two tasks: the last record is the run's result
        decision.desk.end()
        return None
