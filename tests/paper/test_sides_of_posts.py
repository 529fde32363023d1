"""A wish on posts in the flow: a task converges where the sides are seen to be right, and else says what is wrong."""

from dataclasses import replace

from ideal_lab import I, lab, running

from dlokit.communication import topics
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision import api
from dlokit.decision.config import TaskConfig
from dlokit.decision.records import GoalRequest, ShapeResult
from dlokit.description.scene import Post
from dlokit.system.build import decision_of
from dlokit.types.flow import RunOutcome
from dlokit.types.outcome import Rejected
from dlokit.types.passing import AsWished, SideWish

POST = Post(name="A", position_m=(0.54, 0.0, 0.0))
"""To the right of an I, which runs along +y through x = 0.52 m: it passes the post clockwise."""


def at_the_goal(turn: int, post: Post = POST) -> tuple[ShapeResult, list[str]]:
    """A task whose rope lies in its goal from the start, with one action at most; and the texts of its steps."""

    async def main() -> tuple[ShapeResult, list[str]]:
        bus = MemoryTransport()
        texts: list[str] = []
        config = TaskConfig(max_actions=1)
        async with running(lab(I), bus, LoopClock(), config, fixtures=(post,)) as host:
            request = GoalRequest(nodes_world=I, name="I", beside=(SideWish(name="A", turn=turn),))
            decision = decision_of(host)
            result = await decision.shape(request, lambda record: None, lambda status: texts.append(status.text))
            assert host.transport.latest(topics.GOAL).value is not None
        return result, texts

    return virtual_time.run(main())


def test_a_rope_at_its_goal_on_the_wished_side_has_converged() -> None:
    result, _ = at_the_goal(1)
    assert (result.outcome, result.history) == (RunOutcome.CONVERGED, ())
    assert result.passing is not None
    assert [one.answer for one in result.passing.answers] == [AsWished.YES]


def test_a_rope_at_its_goal_on_the_wrong_side_has_not_and_the_reason_says_so() -> None:
    result, texts = at_the_goal(-1)
    assert result.outcome is not RunOutcome.CONVERGED
    assert result.rmse_m < 0.012
    assert result.reason is not None
    assert result.reason.endswith("the DLO passes A clockwise")
    assert "the DLO passes A clockwise" in texts  # while the task goes on


def test_a_side_within_the_uncertainty_is_not_seen_and_not_converged() -> None:
    result, _ = at_the_goal(1, replace(POST, position_m=(0.521, 0.0, 0.0)))
    assert result.outcome is not RunOutcome.CONVERGED
    assert result.reason is not None
    assert result.reason.endswith("the DLO is not seen well enough beside A")


def test_a_request_that_names_no_post_is_rejected() -> None:
    async def main() -> None:
        async with running(lab(I), MemoryTransport(), LoopClock(), fixtures=(POST,)) as host:
            request = GoalRequest(nodes_world=I, name="I", beside=(SideWish(name="X"),))
            outcome = await host.transport.call(api.SHAPE_DLO, request)
            assert isinstance(outcome, Rejected)
            assert outcome.reason == "unknown_post"
            assert "the posts are A" in outcome.detail

    virtual_time.run(main())
