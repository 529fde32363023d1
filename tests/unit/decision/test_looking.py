"""Waiting times for a new state."""

import asyncio
from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest

from dlokit.communication import topics
from dlokit.communication.port import Port
from dlokit.communication.timing import virtual_time
from dlokit.communication.transport import Liveness, Mailbox
from dlokit.decision.config import TaskConfig
from dlokit.decision.flow import FaultKind, StepFault
from dlokit.decision.looking import LOOK_AGAIN_S, LOOK_TIMEOUT_S, look, state_after
from dlokit.decision.task import Odometer, ShapeTask, Spent
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.types.dlo import DloState
from dlokit.types.flow import OperatorCommand
from dlokit.types.outcome import Succeeded

CONFIG = TaskConfig()
MODEL = BelievedDlo()
STATE = DloState(stamp_ns=0, nodes_world=np.zeros((MODEL.nodes, 3)), topology=topology(MODEL))


class Bus:
    """A bus on which a component is lost or replaced from a given time on."""

    def __init__(self, gone: str, from_s: float, *, replaced: bool) -> None:
        self._gone, self._from_s, self._replaced = gone, from_s, replaced

    def alive(self, component: str) -> Liveness:
        if component != self._gone or asyncio.get_running_loop().time() < self._from_s:
            return Liveness(True, "1")
        return Liveness(True, "2") if self._replaced else Liveness(False)


class Blind(Bus):
    """A bus on which all components are present, and only the nth observation yields a state."""

    def __init__(self, states: Mailbox[DloState], brings_from: int) -> None:
        super().__init__("nobody", 0.0, replaced=False)
        self._states, self._brings_from = states, brings_from
        self.looks = 0

    async def call(self, skill: object) -> Succeeded[SimpleNamespace]:
        self.looks += 1
        stamp_ns = 1_000 * self.looks
        if self.looks >= self._brings_from:
            self._states.put(msgspec.structs.replace(STATE, observed_stamp_ns=stamp_ns), 0.0)
        return Succeeded(result=SimpleNamespace(stamp_ns=stamp_ns))


def _task(bus: Bus, states: Mailbox[DloState]) -> ShapeTask:
    """A task whose observer is initialised."""
    port = cast(Port, bus)
    commands: Mailbox[OperatorCommand] = Mailbox(topics.COMMAND.policy)
    return ShapeTask(
        port=port,
        config=CONFIG,
        request=None,
        stopwatch=lambda: 0.0,
        odometer=Odometer(),
        states=states,
        commands=commands,
        recorded=lambda record: None,
        spent=Spent(started_ns=0),
        servers={"observer": "1"},
    )


async def looked(brings_from: int) -> tuple[DloState | StepFault, int, float]:
    """State (or why there is none), number of observations and time [s] if only the nth yields a state."""
    began_s = asyncio.get_running_loop().time()
    states: Mailbox[DloState] = Mailbox(topics.STATE.policy)
    bus = Blind(states, brings_from)
    try:
        found: DloState | StepFault = await look(_task(bus, states))
    except StepFault as fault:
        found = fault
    return found, bus.looks, asyncio.get_running_loop().time() - began_s


async def waited_s(gone: str, after_s: float, *, replaced: bool = False) -> float:
    """Time for which a state that does not arrive is awaited [s]."""
    began_s = asyncio.get_running_loop().time()
    states: Mailbox[DloState] = Mailbox(topics.STATE.policy)
    with pytest.raises(StepFault, match="no model state within") as missed:
        await state_after(_task(Bus(gone, began_s + after_s, replaced=replaced), states), stamp_ns=1)
    assert missed.value.kind is FaultKind.LOST
    return asyncio.get_running_loop().time() - began_s


@pytest.mark.parametrize("component", ["observer", "model"])
def test_there_is_no_wait_for_a_state_while_its_publisher_is_lost(component: str) -> None:
    for after_s in (0.0, 3.0):
        assert after_s <= virtual_time.run(waited_s(component, after_s)) < after_s + 1.0


def test_there_is_no_wait_for_a_state_from_an_uninitialised_observer() -> None:
    for after_s in (0.0, 3.0):
        assert after_s <= virtual_time.run(waited_s("observer", after_s, replaced=True)) < after_s + 1.0


def test_a_missing_state_is_awaited_to_the_limit_while_all_components_are_present() -> None:
    assert virtual_time.run(waited_s("nobody", 0.0)) == pytest.approx(LOOK_TIMEOUT_S)


def test_an_observation_without_a_result_is_repeated_while_all_components_are_present() -> None:
    found, looks, waiting_s = virtual_time.run(looked(brings_from=3))
    assert isinstance(found, DloState)
    assert looks == 3
    assert waiting_s == pytest.approx(2 * LOOK_AGAIN_S)


def test_observations_without_a_result_end_within_the_time_of_one() -> None:
    found, looks, waiting_s = virtual_time.run(looked(brings_from=1000))
    assert isinstance(found, StepFault)
    assert found.kind is FaultKind.LOST
    assert looks == LOOK_TIMEOUT_S / LOOK_AGAIN_S
    assert waiting_s == pytest.approx(LOOK_TIMEOUT_S)
