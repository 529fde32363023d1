"""How long a state is waited for."""

import asyncio
from types import SimpleNamespace
from typing import cast

import msgspec
import numpy as np
import pytest

from dlokit.communication import topics
from dlokit.communication.timing import virtual_time
from dlokit.communication.transport import Known, Liveness, Mailbox
from dlokit.decision.config import TaskConfig
from dlokit.decision.looking import look, state_after
from dlokit.decision.task import ShapeTask
from dlokit.rod.believed import ModelConfig
from dlokit.rod.nodes import topology
from dlokit.types.dlo import DloState
from dlokit.types.outcome import Succeeded

CONFIG = TaskConfig()
MODEL = ModelConfig()
STATE = DloState(stamp_ns=0, nodes_world=np.zeros((MODEL.nodes, 3)), topology=topology(MODEL))


class Bus:
    """On which a component is gone, or another one's, from a time on."""

    def __init__(self, gone: str, from_s: float, *, replaced: bool) -> None:
        self._gone, self._from_s, self._replaced = gone, from_s, replaced

    def alive(self, component: str) -> Liveness:
        if component != self._gone or asyncio.get_running_loop().time() < self._from_s:
            return Known(True, "1")
        return Known(True, "2") if self._replaced else Known(False)


class Blind(Bus):
    """On which all are there, and a look brings a state only from its nth time on."""

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


async def looked(brings_from: int) -> tuple[DloState | None, int, float, ShapeTask]:
    """State, looks, time [s] and task of a look that brings something only from its nth time on."""
    began_s = asyncio.get_running_loop().time()
    states: Mailbox[DloState] = Mailbox(topics.STATE.policy)
    bus = Blind(states, brings_from)
    task = cast(
        ShapeTask, SimpleNamespace(port=bus, states=states, config=CONFIG, tracked_by="1", lost="", reason=None)
    )
    state = await look(task)
    return state, bus.looks, asyncio.get_running_loop().time() - began_s, task


async def waited_s(gone: str, after_s: float, *, replaced: bool = False) -> tuple[float, ShapeTask]:
    began_s = asyncio.get_running_loop().time()
    bus = Bus(gone, began_s + after_s, replaced=replaced)
    states: Mailbox[DloState] = Mailbox(topics.STATE.policy)
    task = cast(
        ShapeTask, SimpleNamespace(port=bus, states=states, config=CONFIG, tracked_by="1", lost="", reason=None)
    )
    assert await state_after(task, stamp_ns=1) is None
    return asyncio.get_running_loop().time() - began_s, task


@pytest.mark.parametrize("component", ["observer", "model"])
def test_nobody_waits_for_a_state_while_who_makes_it_is_gone(component: str) -> None:
    for after_s in (0.0, 3.0):
        waiting_s, task = virtual_time.run(waited_s(component, after_s))
        assert after_s <= waiting_s < after_s + 1.0
        assert task.lost == "observer"


def test_nobody_waits_for_a_state_from_an_observer_that_was_not_told_where_the_dlo_lies() -> None:
    for after_s in (0.0, 3.0):
        waiting_s, task = virtual_time.run(waited_s("observer", after_s, replaced=True))
        assert after_s <= waiting_s < after_s + 1.0
        assert task.lost == "observer"


def test_a_state_that_does_not_come_though_all_are_there_is_waited_for_to_the_end() -> None:
    waiting_s, task = virtual_time.run(waited_s("nobody", 0.0))
    assert waiting_s == pytest.approx(CONFIG.look_timeout_s)
    assert task.lost == "observer"
    assert task.reason is not None
    assert "no model state within" in task.reason


def test_a_look_of_which_nothing_came_is_done_again_while_all_are_there() -> None:
    state, looks, waiting_s, task = virtual_time.run(looked(brings_from=3))
    assert state is not None
    assert looks == 3
    assert waiting_s == pytest.approx(2 * CONFIG.look_again_s)
    assert (task.lost, task.reason) == ("", None)


def test_looks_of_which_nothing_comes_end_in_the_time_of_one() -> None:
    state, looks, waiting_s, task = virtual_time.run(looked(brings_from=1000))
    assert state is None
    assert looks == CONFIG.look_timeout_s / CONFIG.look_again_s
    assert waiting_s == pytest.approx(CONFIG.look_timeout_s)
    assert task.lost == "observer"
