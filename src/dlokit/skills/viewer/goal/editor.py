"""The goal on the page: its earlier values, its changes, and the planner's verdict while it changes."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from typing import Any

import numpy as np

from dlokit import geometry
from dlokit.communication.container import end_tasks
from dlokit.communication.port import Port
from dlokit.communication.skill import Skill
from dlokit.communication.timing.clock import LoopClock
from dlokit.description.point_files import points_of_csv
from dlokit.description.shapes import LENGTH_TOLERANCE, builtin_shape, fit_length, length
from dlokit.errors import ShapeError
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.feasibility import GoalVerdict
from dlokit.types.flow import GoalFrame
from dlokit.types.outcome import Succeeded
from dlokit.types.passing import SideWish

_KEPT = 50
"""Number of changes that can be undone."""
_BETWEEN_VERDICTS_S = 0.1
"""Wait between two verdicts while the goal changes [s]; a verdict takes about the same time."""


@dataclass(frozen=True, kw_only=True)
class RodOutline:
    """Nodes and size of the rod, to draw it before the first state arrives."""

    nodes: int
    """Nodes of the model."""
    length_m: float
    radius_m: float

    def on_table(self, line: Float64Array) -> Float64Array:
        """A line (K, 2) [m] on the table, nearly as long as the rod, as nodes (M, 3) [m] of exactly its length."""
        nodes = np.column_stack([geometry.resample(line, self.nodes), np.full(self.nodes, self.radius_m)])
        return fit_length(nodes, self.length_m)


@dataclass(frozen=True, kw_only=True)
class GoalSkills:
    """The skills that set and judge a goal."""

    set_goal: Skill[[Float64Array, str, bool, tuple[SideWish, ...] | None], GoalShape]
    build_goal: Skill[[tuple[GoalFrame, ...]], GoalShape]
    judge_goal: Skill[[GoalShape, float], GoalVerdict]


def goal_name(goal: GoalShape) -> str:
    """The name of a goal for people: a file without its folders."""
    return "dragged" if goal.name == "frames" else goal.name.rpartition("/")[2] or "without a name"


class GoalEditor:
    """Sets goals through the model, and asks the planner for one verdict at a time."""

    def __init__(
        self, skills: GoalSkills | None, rod: RodOutline, threshold_m: float, port: Callable[[], Port]
    ) -> None:
        """`port` is known once the component runs; None for `skills`: the goal is shown and not changed."""
        self._skills, self._rod, self._threshold_m, self._port = skills, rod, threshold_m, port
        self._previous: list[tuple[Float64Array, str]] = []
        self._calls: set[asyncio.Task[Any]] = set()
        self._judging: asyncio.Task[None] | None = None
        self._judged: GoalShape | None = None
        self.goal: GoalShape | None = None
        """The present goal."""
        self.verdict: GoalVerdict | None = None
        """The verdict on it; None while it is judged."""
        self.notice = ""
        """Why the last change had no effect; empty if it had one."""

    @property
    def undoable(self) -> bool:
        """Whether there was another goal before."""
        return bool(self._previous)

    def on_goal(self, goal: GoalShape) -> None:
        """Note the goal that the model has published."""
        self.goal, self.verdict = goal, None

    def on_verdict(self, verdict: GoalVerdict) -> None:
        """Note a verdict. A verdict on an earlier goal is shown until the next one, which is already requested."""
        self.verdict = verdict

    def judge(self) -> None:
        """Ask for a verdict on the goal, unless it was asked for; called again when the goal changes."""
        if self._skills is not None and self.goal is not self._judged and self._judging is None:
            self._judging = asyncio.create_task(self._judge(self._skills), name="goal verdicts")

    def take_builtin(self, name: str) -> None:
        """Take a built-in shape."""
        rod = self._rod
        self.take(builtin_shape(name, rod.length_m, rod.nodes, radius_m=rod.radius_m), name)

    def take_csv(self, data: bytes, name: str) -> None:
        """Take the curve of a `.csv` file; a curve of another length than the DLO is refused."""
        try:
            points = points_of_csv(data, name)
        except ShapeError as error:
            self.notice = str(error)
            return
        long_m = length(points[:, :2])
        if abs(long_m - self._rod.length_m) > LENGTH_TOLERANCE * self._rod.length_m:
            self.notice = (
                f"{name} is {long_m:.3f} m long and the DLO {self._rod.length_m:.3f} m; a difference of "
                f"{LENGTH_TOLERANCE:.0%} is allowed."
            )
            return
        self.take(self._rod.on_table(points[:, :2]), name)

    def take(self, nodes_world: Float64Array, name: str) -> None:
        """Take a curve (K, 3) [m]; `undo` takes the previous goal."""
        self.remember()
        self._set(nodes_world, name)

    def undo(self) -> None:
        """Take the previous goal."""
        if self._previous:
            self._set(*self._previous.pop())

    def remember(self) -> None:
        """Keep the present goal for `undo`."""
        if self.goal is not None:
            self._previous = [*self._previous, (self.goal.nodes_world, self.goal.name)][-_KEPT:]

    def settle(self, frames: tuple[GoalFrame, ...]) -> None:
        """Let the goal rod come to rest under the frames, after a drag."""
        if self._skills is not None:
            self._call(self._asked(self._skills.build_goal, frames))

    async def close(self) -> None:
        """End all calls."""
        await end_tasks(*self._calls, *([self._judging] if self._judging else []))

    def _set(self, nodes_world: Float64Array, name: str) -> None:
        if self._skills is not None:
            self._call(self._asked(self._skills.set_goal, nodes_world, name, False, None))

    def _call(self, asked: Coroutine[Any, Any, None]) -> None:
        call = asyncio.create_task(asked, name="goal")
        self._calls.add(call)
        call.add_done_callback(self._calls.discard)

    async def _asked(self, skill: Skill[Any, Any], *arguments: Any) -> None:
        outcome = await self._port().call(skill, *arguments)
        self.notice = "" if isinstance(outcome, Succeeded) else f"The goal was not changed: {outcome.why}"

    async def _judge(self, skills: GoalSkills) -> None:
        """Judge until the newest goal is judged: while it changes, one verdict follows the other."""
        try:
            while (goal := self.goal) is not None and goal is not self._judged:
                self._judged = goal
                # The verdict arrives on its topic, like the verdicts of a task.
                await self._port().call(skills.judge_goal, goal, self._threshold_m)
                await LoopClock().sleep(_BETWEEN_VERDICTS_S)
        finally:
            self._judging = None
