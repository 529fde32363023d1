"""`dlokit/Shape-v0`: one step is one action, from the grasp to the release."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Unpack

from dlokit.extras.gym.environment import DloEnvironment, Reward
from dlokit.extras.gym.grasp_actions import GraspActions, GraspBy, PathBy
from dlokit.extras.gym.observations import Observations, Sight
from dlokit.extras.gym.settings import Curve, episodes_of
from dlokit.extras.gym.shape_course import ShapeCourse
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.request import Choices
from dlokit.types.arrays import Float32Array


class ShapeEnv(DloEnvironment):
    """Bring a DLO from a start to a goal, a grasp at a time, through the same components as `dlokit.shape`."""

    def __init__(
        self,
        start: Curve = "random",
        goal: Curve = "S",
        *,
        grasp: GraspBy = "node",
        path: PathBy = "carry",
        observation: Sequence[Sight] = ("nodes",),
        cloud_points: int = 512,
        privileged: bool = False,
        reward: Reward = "progress",
        max_actions: int = 40,
        settings: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        **choices: Unpack[Choices],
    ) -> None:
        """`grasp` and `path` choose the encoding of an action (`GraspActions`).

        `observation` has any of nodes, cloud (of `cloud_points` points) and picture; the goal is always there.
        `privileged` adds the true nodes to the observation and the true error to `info`. After `max_actions` steps an
        episode is truncated. `choices` (``dlo``, ``camera``, ``observer``, …) and `settings` are those of
        `dlokit.shape`: ``planner`` is the expert, ``randomised`` draws properties of the cell from the seed, all, or
        those named. Raises `ConfigError` for one that cannot work.
        """
        episodes = episodes_of(start, goal, settings, choices)
        run = episodes.config
        expert = _within(path, run.planning.strategy)
        episodes = replace(episodes, config=replace(run, planning=replace(run.planning, strategy=expert)))
        table = run.planning.feasibility
        self.actions = GraspActions(
            grasp, path, table_x_m=table.table_x_m, table_y_m=table.table_y_m, length_m=run.model.length_m
        )
        """The encoding of actions."""
        super().__init__(
            episodes,
            Observations(run, observation, cloud_points=cloud_points, privileged=privileged),
            self.actions.space,
            reward=reward,
            max_steps=max_actions,
            privileged=privileged,
            render_mode=render_mode,
            arguments=(grasp, path, max_actions),
        )

    def expert(self) -> Float32Array | None:
        """The action of the configured planner in the present state; None if it has no valid one.

        The call takes as long as a decision of that planner, and does not change the episode.
        """
        if not isinstance(self._course, ShapeCourse) or self._ended:
            return None
        return self._course.expert_vector()

    def _new_course(self, config: RunConfig, job: ShapeJob) -> ShapeCourse:
        return ShapeCourse(config, job, self.actions)


def _within(path: PathBy, expert: StrategyConfig) -> StrategyConfig:
    """The expert, limited to the kinds of actions that the encoding can express."""
    if not isinstance(expert, RolloutConfig):
        return expert
    return replace(expert, lay_down=expert.lay_down and path == "poses", push=False)
