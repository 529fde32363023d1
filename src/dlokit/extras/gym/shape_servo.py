"""`dlokit/ShapeServo-v0`: one step is a short motion of the tool, given by its velocity."""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Unpack

import numpy as np
from gymnasium import spaces

from dlokit.errors import ConfigError
from dlokit.extras.gym.environment import DloEnvironment, Reward
from dlokit.extras.gym.observations import Observations, Sight
from dlokit.extras.gym.servo_course import ServoCourse, ToolMotion
from dlokit.extras.gym.settings import Curve, episodes_of
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.request import Choices


class ShapeServoEnv(DloEnvironment):
    """Bring a DLO from a start to a goal by moving the tool that holds it.

    An action (5,) in -1 to 1 is the velocity of the tool along x, y and z, its turn about the vertical, and the
    fingers: closed above 0, else open. An episode succeeds when the released DLO lies within the threshold of its goal.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 2}

    def __init__(
        self,
        start: Curve = "random",
        goal: Curve = "S",
        *,
        held: bool = True,
        period_s: float = 0.5,
        speed_m_s: float = 0.1,
        turn_rad_s: float = 0.5,
        observation: Sequence[Sight] = ("nodes",),
        cloud_points: int = 512,
        privileged: bool = False,
        reward: Reward = "progress",
        max_steps: int = 200,
        settings: Mapping[str, Any] | None = None,
        render_mode: str | None = None,
        **choices: Unpack[Choices],
    ) -> None:
        """With `held` an episode begins with the node farthest from its goal held; else with the hand above that node.

        `period_s` is the duration of a step, `speed_m_s` and `turn_rad_s` the largest velocities. After `max_steps`
        steps an episode is truncated. The other arguments are those of `ShapeEnv`. Raises `ConfigError` for one
        that cannot work.
        """
        for name, value in (("period_s", period_s), ("speed_m_s", speed_m_s), ("turn_rad_s", turn_rad_s)):
            if not 0.0 < value < np.inf:
                raise ConfigError(f"{name} is {value}; it must be a number above 0.")
        episodes = episodes_of(start, goal, settings, choices)
        self._motion = ToolMotion(period_s=period_s, speed_m_s=speed_m_s, turn_rad_s=turn_rad_s)
        self._held = held
        super().__init__(
            episodes,
            Observations(episodes.config, observation, cloud_points=cloud_points, privileged=privileged, tool=True),
            spaces.Box(-1.0, 1.0, (5,), np.float32),
            reward=reward,
            max_steps=max_steps,
            privileged=privileged,
            render_mode=render_mode,
            arguments=(held, self._motion, max_steps),
        )

    def _new_course(self, config: RunConfig, job: ShapeJob) -> ServoCourse:
        return ServoCourse(config, job, self._motion, held=self._held)
