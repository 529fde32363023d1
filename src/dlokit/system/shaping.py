"""One shape task on a running system, common to both runtimes."""

import asyncio
import contextlib
import math
import time
from collections import defaultdict
from collections.abc import AsyncGenerator, Callable, Generator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import TypeVar

import msgspec

from dlokit import __version__
from dlokit.communication import topics
from dlokit.communication.container import Container, end_tasks
from dlokit.communication.topic import Topic
from dlokit.communication.transport import Transport
from dlokit.decision.component import DecisionComponent, OperatorStart
from dlokit.decision.records import ShapeResult, StepVisit
from dlokit.errors import StartNotConfirmed
from dlokit.system.build import decision_of
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import to_toml
from dlokit.system.job import ShapeJob
from dlokit.system.operator_start import RealStart, confirmed_start
from dlokit.system.results.parts_of_run import changed_settings, parts_of_run
from dlokit.system.results.run_result import (
    REPORT_FILE,
    ActionResult,
    RunRecord,
    RunResult,
    StepTiming,
    TaskSummary,
    VerdictResult,
    action_result,
    camera_result,
    config_hash,
    protection_result,
    verdict_result,
)
from dlokit.system.signals import signals_noted
from dlokit.types.action import Candidates
from dlokit.types.arrays import UInt8Array
from dlokit.types.flow import FlowStatus, OperatorCommand, RunOutcome, RunPhase, TaskEnd
from dlokit.types.image import DepthImage, StereoImages
from dlokit.types.message import Message
from dlokit.types.robot import ArmProtection

M = TypeVar("M", bound=Message)

LINGER_S = 2.2
"""Time for which the cell continues after the last release [s]: the evaluator judges 2 s after it."""


class Watcher:
    """Interface that displays a running task, e.g. in the terminal; this base class displays nothing."""

    def started(self, cancel: Callable[[], object]) -> None:
        """The task runs. `cancel` ends it with outcome `cancelled`, as Ctrl-C does, and may be called on any thread."""

    async def confirm(self, start: RealStart) -> None:
        """Ask an operator whether a real arm may move, before anything moves.

        Raises `StartNotConfirmed` if it may not; by default the run has no operator.
        """
        raise StartNotConfirmed("this run has no operator to ask")

    def page(self, url: str) -> None:
        """The viewer's page is available at this address; called again after a restart of the viewer."""

    def step(self, status: FlowStatus) -> None:
        """Called when the flow has entered another step."""

    def considered(self, candidates: Candidates) -> None:
        """Called when a decision has progressed."""

    def action(self, row: ActionResult) -> None:
        """Called when an action has ended and its effect is measured."""

    def arms_stopped(self, stopped: bool) -> None:
        """A person's stop is latched in an arm of a live run; False: all arms are enabled again."""

    def stopping(self, by: str) -> None:
        """Called within the handler of the signal that ends the run: the arm stops, and the files are written."""

    def interrupted_again(self) -> None:
        """Called within the handler of each later Ctrl-C, until the last file is written; it does not end the run."""

    async def ended(self, number: int, record: RunRecord) -> TaskEnd:
        """Called when one of several tasks has ended: keep its record, and return the summary that the page shows."""
        return task_end(number, record)


def task_end(number: int, record: RunRecord, *, text: str = "", files: Sequence[Path] = ()) -> TaskEnd:
    """The summary of how task `number` of a run ended, with `text`; `files` are paths in the folder of the run."""
    result = record.result
    return TaskEnd(
        number=number,
        goal=result.goal,
        outcome=result.outcome,
        text=text or result.reason or "",
        actions=result.actions,
        rmse_m=result.rmse_m,
        threshold_m=result.threshold_m,
        files=tuple(file.as_posix() for file in files),
    )


class _Album:
    """The first and the last picture of a run."""

    def __init__(self) -> None:
        self.first: UInt8Array | None = None
        self.last: UInt8Array | None = None

    def add(self, picture: StereoImages | DepthImage) -> None:
        """Keep the next picture; a run has one camera, so only one topic carries pictures."""
        self.last = picture.reference
        if self.first is None:
            self.first = picture.reference


@dataclass
class Stop:
    """State that a run and its task share: the signal that stopped them, and whether the task had begun."""

    by: Callable[[], str] = lambda: ""
    """Returns the name of the signal that arrived; empty: none."""
    begun: bool = False
    """Whether the first task has begun; before that, nothing can have moved."""


@contextmanager
def stopped_by_signals(watch: Watcher) -> Generator[Stop]:
    """Cancel the block at the first signal that ends a run, and notify `watch` of it and of later ones."""
    loop = asyncio.get_running_loop()

    def tell(name: str) -> None:
        try:
            watch.stopping(name)
        except (Exception, SystemExit):  # its stream was just being written to, or has gone
            loop.call_soon_threadsafe(watch.stopping, name)

    with signals_noted(tell, watch.interrupted_again) as by:
        yield Stop(by)


def record_of_no_task(config: RunConfig, job: ShapeJob, stop: Stop, *, wall_time_s: float) -> RunRecord:
    """The record of a run that was stopped before its task began."""
    reason = f"nothing has moved: stopped by {stop.by() or 'its caller'} while the system started"
    record = _record(config, job, _nothing_moved(reason), _Album(), (), sim_time_s=0.0, wall_time_s=wall_time_s)
    return replace(record, begun=False)


async def shape(
    host: Container, config: RunConfig, job: ShapeJob, watch: Watcher, stop: Stop | None = None
) -> RunRecord:
    """Run the task to its end, and continue the cell until its last shape can be evaluated.

    `host` runs the decision component. Cancellation ends the task with outcome `cancelled`; `stop` names the signal
    that caused it, or the caller did.
    """
    stop = stop or Stop()
    stop.begun = True
    transport, clock = host.transport, host.clock
    task, loop = asyncio.current_task(), asyncio.get_running_loop()
    assert task is not None
    cancel = task.cancel
    watch.started(lambda: loop.call_soon_threadsafe(cancel))
    album = _Album()
    protections: list[ArmProtection] = []  # of the first arm: no driver of a real arm has several
    forwarding = (
        _forward(transport, topics.STEREO_IMAGES, album.add),
        _forward(transport, topics.DEPTH_IMAGES, album.add),
        _forward(transport, topics.VIEWER_PAGE, lambda page: watch.page(page.url), with_last=True),
        _forward(transport, topics.FLOW, watch.step),
        _forward(transport, topics.CANDIDATES, watch.considered),
        _forward(transport, topics.PROTECTION, protections.append, with_last=True),
    )
    helpers = [asyncio.create_task(one) for one in forwarding]
    began_s, began_ns = time.perf_counter(), clock.now_ns()
    try:
        refused = await _refused_start(transport, config, job, watch, stop.by)
        result = refused or await decision_of(host).shape(
            job.request,
            lambda record: watch.action(action_result(record)),
            resumed=job.resumed,
            canceller=stop.by,
            start=OperatorStart(command=job.start, shown=job.shown, takes_over=job.takes_over),
        )
        # The result is final; an interrupt from now on does not discard it.
        with contextlib.suppress(asyncio.CancelledError):
            await clock.sleep_until(_judged_from_ns(result, clock.now_ns()))
    finally:
        with contextlib.suppress(asyncio.CancelledError):
            await end_tasks(*helpers)
    return _record(
        config,
        job,
        result,
        album,
        protections,
        sim_time_s=(clock.now_ns() - began_ns) / 1e9,
        wall_time_s=time.perf_counter() - began_s,
    )


def _judged_from_ns(result: ShapeResult, now_ns: int) -> int:
    """Until when the cell continues after a task that ends now [ns]: its last shape can then be judged.

    A stopped task that has released nothing leaves no shape that would settle.
    """
    last_ns = result.history[-1].release_stamp_ns if result.history else None
    if last_ns is None and result.outcome is RunOutcome.CANCELLED:
        return now_ns
    return (now_ns if last_ns is None else last_ns) + round(LINGER_S * 1e9)


async def _refused_start(
    transport: Transport, config: RunConfig, job: ShapeJob, watch: Watcher, canceller: Callable[[], str]
) -> ShapeResult | None:
    """Ask the operator for the start of a real arm; returns the result of the task if refused, None if it may start."""
    try:
        await confirmed_start(transport, config, watch, resumed=job.resumed is not None)
    except StartNotConfirmed as error:
        why = str(error)
    except asyncio.CancelledError:
        why = f"stopped by {canceller() or 'its caller'}"
    else:
        return None
    return _nothing_moved(f"the start was not confirmed, and nothing has moved: {why}")


def _nothing_moved(reason: str) -> ShapeResult:
    """The result of a task that was cancelled before it began."""
    return ShapeResult(
        outcome=RunOutcome.CANCELLED,
        reason=reason,
        rmse_m=math.nan,
        best_rmse_m=math.nan,
        goal=None,
        start_nodes_world=None,
        start_stamp_ns=0,
        start_rmse_m=None,
        history=(),
        verdict=None,
        asked=None,
        asked_rmse_m=None,
        timings=(),
        planning_time_s=0.0,
    )


@asynccontextmanager
async def stops_watched(transport: Transport, watch: Watcher) -> AsyncGenerator[None]:
    """Notify `watch` of each stop of an arm by a person, and of its end, while the context is open."""

    async def follow() -> None:
        latched: dict[str, bool] = {}
        stopped = False
        async for state in transport.stream(topics.ROBOT_STATE, with_last=True):
            latched[state.robot] = state.stop_latched
            if stopped is not any(latched.values()):
                stopped = not stopped
                watch.arms_stopped(stopped)

    following = asyncio.create_task(follow(), name="stops of the arms")
    try:
        yield
    finally:
        with contextlib.suppress(asyncio.CancelledError):  # it must not discard the result of the run
            await end_tasks(following)


async def _forward(
    transport: Transport, topic: Topic[M], receive: Callable[[M], object], *, with_last: bool = False
) -> None:
    """Call `receive` with each message of a topic; with `with_last`, also with the last one that was published."""
    async for message in transport.stream(topic, with_last=with_last):
        receive(message)


def _record(
    config: RunConfig,
    job: ShapeJob,
    result: ShapeResult,
    album: _Album,
    protections: Sequence[ArmProtection],
    *,
    sim_time_s: float,
    wall_time_s: float,
) -> RunRecord:
    toml = to_toml(config)
    goal = result.goal.nodes_world if result.goal is not None else None
    if goal is None and job.request is not None:
        goal = job.request.nodes_world
    history = tuple(action_result(action) for action in result.history)
    return RunRecord(
        name=job.name,
        began=datetime.now() - timedelta(seconds=wall_time_s),
        result=RunResult(
            outcome=result.outcome,
            reason=result.reason,
            goal=_goal_name(result, job),
            actions=len(history) + result.unfinished,
            rmse_m=None if math.isnan(result.rmse_m) else result.rmse_m,
            start_rmse_m=result.start_rmse_m,
            passing=result.passing,
            threshold_m=config.task.threshold_m,
            seed=config.seed,
            sim_time_s=sim_time_s,
            wall_time_s=wall_time_s,
            planning_time_s=result.planning_time_s,
            history=history,
            config_hash=config_hash(toml),
            version=__version__,
            goal_verdict=_goal_verdict(result),
            camera=None if result.camera is None else camera_result(result.camera),
            twin=config.mirrors_arm,
            interruptions=result.interruptions,
            recoveries=result.recoveries,
            protections=tuple(protection_result(each) for each in protections),
        ),
        verdict=result.verdict,
        goal_nodes_world=job.start_nodes_world if goal is None else goal,
        goal_set=goal is not None,
        fixtures=config.installation.fixtures,
        ends_interchangeable=config.ends_interchangeable,
        start_nodes_world=result.start_nodes_world,
        start_stamp_ns=result.start_stamp_ns,
        actions=result.history,
        timings=_by_step(result.timings),
        image_before=album.first,
        image_after=album.last,
        config_toml=toml,
        parts=parts_of_run(config),
        changed=changed_settings(config),
    )


def _goal_name(result: ShapeResult, job: ShapeJob) -> str:
    goal = job.request if result.goal is None else result.goal
    return "" if goal is None else goal.name.rpartition("/")[2]


def _goal_verdict(result: ShapeResult) -> VerdictResult | None:
    if result.verdict is None:
        return None
    return verdict_result(result.verdict, projected=result.asked is not None, asked_rmse_m=result.asked_rmse_m)


def _by_step(visits: Sequence[StepVisit]) -> dict[str, StepTiming]:
    grouped: defaultdict[str, list[StepVisit]] = defaultdict(list)
    for visit in visits:
        grouped[visit.step].append(visit)
    return {
        step: StepTiming(
            calls=len(group),
            sim_time_s=sum(visit.cell_s for visit in group),
            wall_time_s=sum(visit.machine_s for visit in group),
        )
        for step, group in grouped.items()
    }


async def shape_until_ended(
    host: Container, config: RunConfig, job: ShapeJob, watch: Watcher, stop: Stop | None = None
) -> RunRecord:
    """Run the task of `job`, then one per start of the operator, until the operator ends the run; the last record.

    It lists all tasks. `host` and `stop` are as for `shape`. Cancellation ends the running task with outcome
    `cancelled`, and the run.
    """
    current, decision = asyncio.current_task(), decision_of(host)
    assert current is not None
    decision.desk.stay()
    number, tasks = 1, list[TaskSummary]()
    while True:
        record = _with_task(await shape(host, config, job, watch, stop), number)
        if current.cancelling():
            decision.desk.end()
        keeping = asyncio.ensure_future(watch.ended(number, record))
        try:
            end = await asyncio.shield(keeping)
        except asyncio.CancelledError:  # Ctrl-C while the files of the task are written: they are, and the run ends
            decision.desk.end()
            end = await keeping
        tasks.append(_summary(end, unfinished=record.result.unfinished))
        decision.desk.publish(RunPhase.FINISHING, last=end)
        stopped = record.result.outcome in _LEFT_AS_THEY_WERE
        start = await _next_start(decision, takes_over=stopped)
        if start is None:
            decision.desk.publish(RunPhase.ENDED)
            return _with_task(record, number, tuple(tasks))
        number += 1
        job = replace(job, request=None, shown=False, start=start, takes_over=stopped)


def _with_task(record: RunRecord, number: int, tasks: tuple[TaskSummary, ...] = ()) -> RunRecord:
    """The record of a task with its number, and all tasks of the run where it is the last."""
    return replace(record, result=msgspec.structs.replace(record.result, task=number, tasks=tasks))


def _summary(end: TaskEnd, *, unfinished: bool) -> TaskSummary:
    return TaskSummary(
        number=end.number,
        goal=end.goal,
        outcome=end.outcome,
        actions=end.actions,
        unfinished=unfinished,
        rmse_m=end.rmse_m,
        report=next((file for file in end.files if file.endswith(REPORT_FILE)), ""),
    )


_LEFT_AS_THEY_WERE = frozenset({RunOutcome.CANCELLED, RunOutcome.FAILED})
"""Outcomes after which the arms stay at their last pose, perhaps with the DLO in their fingers."""


async def _next_start(decision: DecisionComponent, *, takes_over: bool) -> OperatorCommand | None:
    """The operator's next start; None when the run ends."""
    if decision.desk.ends.is_set():
        return None
    try:
        return await decision.next_start(takes_over=takes_over)
    except asyncio.CancelledError:  # Ctrl-C between two tasks: the last record is the run's result
        decision.desk.end()
        return None
