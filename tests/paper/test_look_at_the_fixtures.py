"""The steps before those of Fig. 6 where fixtures stand on the table: no arm moves unless they stand as believed."""

import numpy as np
import pytest
from ideal_lab import I, running, shape
from scripted_hardware import Lab

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.decision.api import SEE_GOAL
from dlokit.decision.shape_flow import SHAPE_DLO, resuming, task_chart
from dlokit.description.scene import Post
from dlokit.types.dlo import GoalShape
from dlokit.types.fixtures import FixtureFinding, FixtureSight
from dlokit.types.flow import RunOutcome
from dlokit.types.outcome import Failed, Outcome, Succeeded

POST = Post(name="A", position_m=(0.4, 0.2, 0.0))


def finding(sight: FixtureSight, name: str = "A") -> FixtureFinding:
    return FixtureFinding(
        name=name,
        sight=sight,
        place_world=np.array([0.4, 0.2]),
        offset_m=np.array([0.012, -0.009]),
        larger_m=np.array([0.01, 0.02]),
    )


GOOD = (finding(FixtureSight.AS_BELIEVED),)
MOVED = (finding(FixtureSight.MOVED), finding(FixtureSight.UNKNOWN, ""))


def lab(*findings: tuple[FixtureFinding, ...], checks_camera: bool = False, **fails: list[str]) -> Lab:
    return Lab(nodes=I.copy(), findings=list(findings), checks_camera=checks_camera, fails=fails)


@pytest.mark.parametrize("sight", [FixtureSight.MOVED, FixtureSight.MISSING, FixtureSight.OTHER_SIZE])
def test_a_fixture_that_is_not_as_believed_ends_the_task_before_any_motion(sight: FixtureSight):
    trace = shape(lab((finding(sight),)), I, fixtures=(POST,))
    assert trace.result.outcome is RunOutcome.INFEASIBLE
    assert trace.calls == ["check_fixtures"]
    assert trace.steps == [("check_fixtures", ""), ("infeasible", "otherwise")]


def test_the_reason_names_each_with_its_offset_and_what_to_do():
    reason = shape(lab(MOVED), I, fixtures=(POST,)).result.reason
    assert reason == (
        "fixtures: A stands 15 mm (x +12, y -9) off its place; an unknown thing, 10 mm wide and 20 mm high, is at "
        "(0.400, 0.200) m. Put each where it is described, or correct its description in the file of --fixtures or "
        "--installation; remove what is unknown, or describe it."
    )


def test_a_fixture_that_is_not_seen_is_named_in_a_warning_and_the_task_goes_on(caplog: pytest.LogCaptureFixture):
    trace = shape(lab((*GOOD, finding(FixtureSight.NOT_SEEN, "B"))), I, fixtures=(POST,))
    assert trace.result.outcome is RunOutcome.CONVERGED
    assert "the camera does not see B: nothing checks where they stand" in caplog.text


def test_with_the_corrected_camera_the_fixtures_are_looked_at_again():
    trace = shape(lab(GOOD, MOVED, checks_camera=True), I, fixtures=(POST,))
    assert ("check_camera", "corrected", "check_fixtures_again") in trace.edges()
    assert trace.result.outcome is RunOutcome.INFEASIBLE
    assert trace.calls.count("check_fixtures") == 2
    assert "look" not in trace.calls


def test_a_camera_lost_in_the_look_is_awaited_and_the_fixtures_are_looked_at_before_any_motion():
    trace = shape(lab(GOOD, check_fixtures=["camera_lost"]), I, fixtures=(POST,))
    assert {("check_fixtures", "lost", "restore"), ("restore", "begin", "check_fixtures")} <= trace.edges()
    assert trace.calls[:3] == ["check_fixtures", "check_fixtures", "home"]
    assert trace.result.outcome is RunOutcome.CONVERGED


def test_without_fixtures_the_chart_has_no_step_for_them():
    assert task_chart(dry_run=False, fixtures=False) is SHAPE_DLO
    assert "check_fixtures" not in shape(Lab(nodes=I.copy()), I).calls


@pytest.mark.parametrize("dry_run", [False, True])
def test_a_resumed_task_and_a_dry_run_look_at_the_fixtures_too(dry_run: bool):
    chart = resuming(task_chart(dry_run=dry_run, fixtures=True))
    assert ("take_over", "done", "check_fixtures") in chart.edges()
    assert ("check_fixtures", "otherwise", "infeasible") in chart.edges()


def goal_shown_to(lab: Lab, fixtures: tuple[Post, ...]) -> Outcome[GoalShape]:
    async def main() -> Outcome[GoalShape]:
        bus = MemoryTransport()
        async with running(lab, bus, LoopClock(), fixtures=fixtures):
            return await bus.call(SEE_GOAL)

    return virtual_time.run(main())


def test_no_goal_is_taken_and_no_arm_moves_where_a_fixture_is_not_as_believed():
    here = lab(MOVED)
    seen = goal_shown_to(here, (POST,))
    assert isinstance(seen, Failed)
    assert seen.reason == "fixtures"
    assert "A stands 15 mm (x +12, y -9) off its place" in seen.detail
    assert here.calls == ["check_fixtures"]


@pytest.mark.parametrize("fixtures", [(), (POST,)])
def test_a_goal_is_shown_after_a_look_at_the_fixtures_if_there_are_any(fixtures: tuple[Post, ...]):
    here = lab(GOOD)
    assert isinstance(goal_shown_to(here, fixtures), Succeeded)
    assert here.calls[: len(fixtures) + 1] == ["check_fixtures"] * len(fixtures) + ["home"]
