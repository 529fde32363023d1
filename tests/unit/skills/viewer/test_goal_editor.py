import asyncio
from collections.abc import Callable, Coroutine

import numpy as np
import pytest

from dlokit.communication import topics
from dlokit.communication.component import Component, implements, on
from dlokit.communication.container import Container
from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing import virtual_time
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.point_files import csv_of
from dlokit.description.shapes import builtin_shape
from dlokit.errors import SkillRejected
from dlokit.skills.model import api as model
from dlokit.skills.planning import api as planning
from dlokit.skills.viewer.goal.editor import GoalEditor, GoalSkills, RodOutline
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict, Standing
from dlokit.types.flow import GoalFrame
from dlokit.types.passing import SideWish

ROD = RodOutline(nodes=31, length_m=0.5, radius_m=0.004)
SKILLS = GoalSkills(set_goal=model.SET_GOAL, build_goal=model.BUILD_GOAL, judge_goal=planning.JUDGE_GOAL)
JUDGING_S = 0.1


class Model(Component):
    name = "model"
    publishes = (topics.GOAL,)
    refuses = False

    @implements(model.SET_GOAL)
    async def set_goal(
        self,
        nodes_world: Float64Array,
        name: str = "goal",
        ends_interchangeable: bool = False,
        beside: tuple[SideWish, ...] | None = None,
    ) -> GoalShape:
        if self.refuses:
            raise SkillRejected("bad_shape", "by the test")
        goal = GoalShape(stamp_ns=1, nodes_world=nodes_world, name=name)
        self.port.publish(topics.GOAL, goal)
        return goal

    @implements(model.BUILD_GOAL)
    async def build_goal(self, frames: tuple[GoalFrame, ...]) -> GoalShape:
        return await self.set_goal(builtin_shape("I", 0.5, 31), "frames")


class Planning(Component):
    name = "planning"
    publishes = (topics.GOAL_VERDICT,)

    def __init__(self) -> None:
        super().__init__()
        self.judged: list[str] = []

    @implements(planning.JUDGE_GOAL)
    async def judge_goal(self, goal: GoalShape, threshold_m: float) -> GoalVerdict:
        await self.port.clock.sleep(JUDGING_S)
        self.judged.append(goal.name)
        return GoalVerdict(stamp_ns=1, standing=Standing.HOLDS, threshold_m=threshold_m, goal_world=goal.nodes_world)


class Page(Component):
    name = "viewer"

    def __init__(self) -> None:
        super().__init__()
        self.editor = GoalEditor(SKILLS, ROD, 0.012, lambda: self.port)

    @on(topics.GOAL)
    async def on_goal(self, goal: GoalShape) -> None:
        self.editor.on_goal(goal)
        self.editor.judge()


def _scenario(body: Callable[[GoalEditor, Model, Planning], Coroutine[None, None, None]]) -> None:
    async def main() -> None:
        host = Container(MemoryTransport(), LoopClock())
        page, rod, judge = Page(), Model(), Planning()
        for component in (page, rod, judge):
            host.add(component)
        async with host:
            await body(page.editor, rod, judge)
            await page.editor.close()

    virtual_time.run(main())


def test_goals_are_taken_back_one_after_the_other() -> None:
    async def body(editor: GoalEditor, rod: Model, judge: Planning) -> None:
        assert not editor.undoable
        for name in ("I", "L", "W"):
            editor.take_builtin(name)
            await asyncio.sleep(0.01)
        names: list[str] = []
        while editor.undoable:
            editor.undo()
            await asyncio.sleep(0.01)
            assert editor.goal is not None
            names.append(editor.goal.name)
        assert names == ["L", "I"]

    _scenario(body)


def test_while_a_goal_changes_one_verdict_follows_the_other_and_the_last_goal_is_judged() -> None:
    async def body(editor: GoalEditor, rod: Model, judge: Planning) -> None:
        for number in range(40):  # as a drag, twenty times a second
            editor.take(builtin_shape("I", 0.5, 31), f"{number}")
            await asyncio.sleep(0.05)
        await asyncio.sleep(1.0)
        assert judge.judged[-1] == "39"
        assert 8 <= len(judge.judged) <= 12  # 2 s, at 0.2 s each

    _scenario(body)


def test_a_saved_goal_is_loaded_as_it_was() -> None:
    async def body(editor: GoalEditor, rod: Model, judge: Planning) -> None:
        nodes = builtin_shape("S", 0.5, 31)
        editor.take_csv(csv_of(nodes), "goal.csv")
        await asyncio.sleep(0.01)
        assert editor.goal is not None
        # The chords of a resampled arc are shorter than it, by less than a millimetre over the rod.
        np.testing.assert_allclose(editor.goal.nodes_world, nodes, atol=1e-3)
        assert editor.notice == ""

    _scenario(body)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"x,y\n0,0\n1,0\n", "1.000 m long"),
        (b"x,y\n0,zero\n1,0\n", "is not a row of numbers"),
        (b"\xff", "not text"),
    ],
)
def test_a_file_that_is_no_goal_is_refused_by_name_and_the_goal_stays(data: bytes, why: str) -> None:
    async def body(editor: GoalEditor, rod: Model, judge: Planning) -> None:
        editor.take_builtin("L")
        await asyncio.sleep(0.01)
        editor.take_csv(data, "other.csv")
        await asyncio.sleep(0.01)
        assert why in editor.notice
        assert editor.goal is not None
        assert editor.goal.name == "L"

    _scenario(body)


def test_a_goal_that_the_model_refuses_is_said() -> None:
    async def body(editor: GoalEditor, rod: Model, judge: Planning) -> None:
        rod.refuses = True
        editor.take_builtin("L")
        await asyncio.sleep(0.01)
        assert "bad_shape" in editor.notice

    _scenario(body)
