"""Looking at the DLO until the model's state has settled."""

import asyncio
import contextlib
import logging

from dlokit.communication import topics
from dlokit.decision.faults import result_of
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.task import ShapeTask
from dlokit.geometry import rmse_m
from dlokit.skills.model import api as model
from dlokit.skills.observer import api as observer
from dlokit.skills.perception import api as perception
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.outcome import Outcome, Succeeded

log = logging.getLogger(__name__)

LOOK_TIMEOUT_S = 20.0
"""Longest wait for the model's state after a look [s]."""
LOOK_AGAIN_S = 5.0
"""Wait [s] after which a look without a model state is repeated, if all components are alive: a message was
dropped."""
LOOK_INTERVAL_S = 0.15
"""Time between two looks [s]: a second look at the same moment brings nothing new."""
_MOST_LOOKS = 6
"""Looks after an action, at most: an estimate that still varies is taken as it is."""
_SETTLED_M = 0.0015
"""The estimate has settled when two looks in a row differ by less than this (RMS over nodes) [m]."""
_RESET_M = 0.01
"""If the model state is farther than this from the nodes found again (RMS over nodes) [m], these nodes replace it:
the tracking controller could not drag the model that far."""
_ALIVE_EVERY_S = 0.5
"""Period of checking whether observer and model are alive while a state is awaited [s]."""


async def state_after(task: ShapeTask, stamp_ns: int) -> DloState:
    """The first model state that includes the cloud of `stamp_ns`. Raises `StepFault` when it does not arrive.

    The wait ends when observer or model is gone, or the observer is not the process that was initialised with the DLO:
    the cloud is lost with it.
    """
    state = await _state_within(task, stamp_ns, LOOK_TIMEOUT_S)
    if state is None:
        raise _missed(task, stamp_ns)
    return state


async def _state_within(task: ShapeTask, stamp_ns: int, seconds: float) -> DloState | None:
    with contextlib.suppress(TimeoutError, StopAsyncIteration):
        async with asyncio.timeout(seconds):
            while _is_tracked(task):
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_ALIVE_EVERY_S):
                        return await _state_of(task, stamp_ns)
    return None


def _missed(task: ShapeTask, stamp_ns: int) -> StepFault:
    return StepFault(
        FaultKind.LOST,
        f"no model state within {LOOK_TIMEOUT_S:g} s of the look at {stamp_ns / 1e9:.3f} s: "
        "observer or model does not answer, is gone, or was restarted",
    )


def _is_tracked(task: ShapeTask) -> bool:
    """Whether observer and model are alive, and the observer is the process that was initialised."""
    name = observer.INITIALISE.component
    tracking = task.port.alive(name)
    initialised = tracking.alive and tracking.server == task.servers.get(name, "")
    return initialised and task.port.alive(model.SET_GOAL.component).alive


async def initialise_observer(
    task: ShapeTask, stamp_ns: int = 0, expected_world: Float64Array | None = None
) -> Outcome[TargetPoints]:
    """Let the observer order the cloud of `stamp_ns` (0: the newest) into nodes, and track the DLO from there."""
    name = observer.INITIALISE.component
    server = task.port.alive(name).server
    outcome = await task.port.call(observer.INITIALISE, stamp_ns, expected_world)
    if isinstance(outcome, Succeeded):
        task.servers[name] = server
    return outcome


async def find(task: ShapeTask, stamp_ns: int = 0, expected_world: Float64Array | None = None) -> None:
    """As `initialise_observer`, and wait for the model's state of it. Raises `StepFault` when the DLO is not found."""
    found = result_of(observer.INITIALISE, await initialise_observer(task, stamp_ns, expected_world))
    task.state = await state_after(task, found.stamp_ns)


async def find_from_scratch(task: ShapeTask) -> None:
    """Look, and reset observer and model, because a person may have moved the DLO. Raises `StepFault`."""
    if task.port.latest(topics.STATE).value is not None:
        await task.ask(model.RESET)
    seen = await task.ask(perception.LOOK)
    await find(task, seen.stamp_ns)


async def _state_of(task: ShapeTask, stamp_ns: int) -> DloState:
    while True:
        state = await anext(task.states)
        if state.observed_stamp_ns >= stamp_ns:
            return state


async def look(task: ShapeTask) -> DloState:
    """Look once: pictures → cloud → target points → model. Raises `StepFault` when the DLO is not seen.

    The look is repeated if no state arrives although all components are alive: a message was dropped.
    """
    loop = asyncio.get_running_loop()
    end_s, first_ns = loop.time() + LOOK_TIMEOUT_S, None
    while True:
        seen = await task.ask(perception.LOOK)
        first_ns = seen.stamp_ns if first_ns is None else first_ns
        left_s = end_s - loop.time()
        # The state of an earlier look suffices: on a busy machine it may be late, and not lost.
        state = await _state_within(task, first_ns, min(LOOK_AGAIN_S, left_s))
        if state is not None:
            return state
        if left_s <= LOOK_AGAIN_S or not _is_tracked(task):
            raise _missed(task, first_ns)
        log.warning("no model state within %g s of a look; looking again", LOOK_AGAIN_S)


async def look_and_reinitialise(task: ShapeTask, expected_world: Float64Array) -> None:
    """Order the cloud from scratch, in the direction that is nearer to `expected_world` (M, 3) [m].

    The shape tracked behind the arm may be wrong, even reversed. If the cloud cannot be ordered, the tracked state is
    kept. Raises `StepFault` when the DLO is not seen, or a component does not answer.
    """
    await task.port.clock.sleep(LOOK_INTERVAL_S)
    task.state = await look(task)
    found = await initialise_observer(task, task.state.observed_stamp_ns, expected_world)
    if not isinstance(found, Succeeded):
        return
    task.state = await state_after(task, found.result.stamp_ns)
    if rmse_m(task.state.nodes_world, found.result.nodes_world) > _RESET_M:
        await task.port.call(model.RESET, found.result.nodes_world)


async def settle(task: ShapeTask) -> None:
    """Look until two successive states agree, or all looks are used. Raises `StepFault` when the DLO is not seen."""
    before: DloState | None = None
    for _ in range(_MOST_LOOKS):
        # Also before the first: the observer ignores a second look at the same moment.
        await task.port.clock.sleep(LOOK_INTERVAL_S)
        state = task.state = await look(task)
        if before is not None and rmse_m(before.nodes_world, state.nodes_world) < _SETTLED_M:
            return
        before = state
