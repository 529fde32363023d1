"""A rope that slips out of the fingers is detected; the DLO's parameters are learned from actions."""

import asyncio

import pytest
from ideal_lab import I, S, lab, running, shape
from scripted_hardware import Lab

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision import convergence
from dlokit.decision.config import TaskConfig
from dlokit.decision.journal import Journal
from dlokit.decision.records import GoalRequest
from dlokit.system.build import decision_of


def test_a_rope_that_slips_out_during_the_carry_is_released_and_observed_again() -> None:
    slippery = lab(I)
    slippery.feels = True
    slippery.slips = 1
    trace = shape(slippery, S, TaskConfig(max_actions=2))
    assert ("move_to_goal", "slipped", "release") in trace.edges()
    assert [record.slipped for record in trace.result.history] == [True, False]
    assert trace.result.history[0].grasp_ok
    carry = trace.calls.index("follow_path")
    assert trace.calls[carry + 1 : carry + 4] == ["halt", "tracking 0", "release"]


def test_a_node_at_which_the_rope_slipped_twice_is_not_grasped_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(convergence, "CHANGED_M", 0.0)
    slippery = lab(I)
    slippery.feels = True
    slippery.slips = 20
    # A change of the error clears the marks of Fig. 6; only slipped nodes stay excluded.
    trace = shape(slippery, S, TaskConfig(max_actions=7))
    nodes = [record.grasp_node for record in trace.result.history]
    assert all(record.slipped for record in trace.result.history)
    assert max(nodes.count(node) for node in nodes) <= 2


def test_a_rope_that_did_not_move_though_it_seemed_held_has_slipped() -> None:
    stubborn = lab(I)
    stubborn.obeys = False
    trace = shape(stubborn, S, TaskConfig(max_actions=1))
    (record,) = trace.result.history
    assert record.grasp_ok
    assert record.slipped


@pytest.mark.parametrize("learn", [True, False])
def test_the_dlo_is_learned_from_an_action_if_configured(learn: bool) -> None:
    feeling = lab(I)
    feeling.feels = True
    trace = shape(feeling, S, TaskConfig(max_actions=1, learn=learn))
    assert trace.belief is not None
    assert trace.belief.actions == (1 if learn else 0)


@pytest.mark.parametrize("cause", ["lease_lost", "lost_commander", "table_collision"])
def test_an_interrupted_carry_is_named_by_its_cause_and_is_not_a_slip(cause: str) -> None:
    late = lab(I)
    late.fails["follow_path"] = [cause]
    trace = shape(late, S, TaskConfig(max_actions=2, learn=True))
    first, second = trace.result.history
    assert (first.grasp_ok, first.slipped, first.ended_by) == (True, False, cause)
    assert (second.slipped, second.ended_by) == (False, None)
    # An interrupted action provides no information on the DLO.
    assert trace.belief is not None
    assert trace.belief.actions == 1


def test_a_node_where_the_arm_braked_twice_may_be_grasped_again() -> None:
    late = lab(I)
    late.fails["follow_path"] = ["lease_lost"] * 3
    journals: list[Journal] = []

    async def main() -> None:
        config = TaskConfig(max_actions=4)
        async with running(late, MemoryTransport(), LoopClock(), config, keep=journals.append) as host:
            await decision_of(host).shape(GoalRequest(nodes_world=S, name="S"), lambda record: None)

    virtual_time.run(main())
    assert journals[-1].slips == ()


def test_a_slip_is_named_as_the_end_of_its_action() -> None:
    slippery = lab(I)
    slippery.feels = True
    slippery.slips = 1
    history = shape(slippery, S, TaskConfig(max_actions=2)).result.history
    assert [record.ended_by for record in history] == ["slipped", None]


@pytest.mark.parametrize("skill", ["move_to", "move_linear"])
def test_an_action_ended_by_the_lease_before_its_grasp_is_named(skill: str) -> None:
    late = lab(I)
    late.fails[skill] = ["lease_lost"]
    (record,) = shape(late, S, TaskConfig(max_actions=1)).result.history
    assert (record.grasp_ok, record.ended_by) == (False, "lease_lost")


def test_an_interruption_after_the_release_does_not_end_the_action() -> None:
    late = lab(I)
    late.fails["release"] = ["", "lease_lost"]
    (record,) = shape(late, S, TaskConfig(max_actions=1)).result.history
    assert record.ended_by is None


def test_a_process_that_was_frozen_has_time_to_send_a_heartbeat_before_the_arm_is_recovered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    late, entered_s, enter = lab(I), dict[str, float](), Lab.enter

    def noted(self: Lab, call: str) -> None:
        entered_s.setdefault(call, asyncio.get_running_loop().time())
        enter(self, call)

    monkeypatch.setattr(Lab, "enter", noted)
    late.fails["follow_path"] = ["lease_lost"]
    shape(late, S, TaskConfig(max_actions=1))
    assert entered_s["recover"] - entered_s["follow_path"] >= 0.1  # within which one is sent, after any freeze
