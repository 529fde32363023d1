"""Base of both environments: seeds, reward, ends, pictures, and the state of an episode."""

import hashlib
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, get_args

import cv2
import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from dlokit.communication import topics
from dlokit.errors import BadValue, ConfigError, DlokitError, ShapeError, require_cell
from dlokit.extras.gym.course import EpisodeCourse, StepResult
from dlokit.extras.gym.observations import Observations, TrueNodes, calibration_of
from dlokit.extras.gym.settings import Episodes
from dlokit.functional.cell.rendering import check_not_forked
from dlokit.geometry.camera import project
from dlokit.skills.observer.kernels import load_kernels
from dlokit.skills.planning.config import load
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.types.arrays import Float32Array, Float64Array, UInt8Array
from dlokit.types.dlo import GoalShape
from dlokit.types.flow import RunOutcome
from dlokit.types.image import CameraCalibration

Reward = Literal["progress", "sparse"]
"""progress: the reduction of the RMSE by a step, in thresholds, and 1 for success. sparse: 1 for success, else 0."""
PRIVILEGED_RMSE = "privileged_true_rmse_m"
"""Name of the true error in `info`."""
_GOAL_RGB, _NODES_RGB = (60, 200, 90), (250, 200, 40)


@dataclass(frozen=True, eq=False)
class EpisodeState:
    """An episode so far: its seed, its options and its actions. `restore` repeats it, equal to the bit.

    It can be pickled, and restored in another process on the same machine.
    """

    environment: str
    """Check sum of the environment's arguments."""
    seed: int
    options: Mapping[str, Any]
    actions: tuple[Float32Array, ...]
    random: Mapping[str, Any]
    """State of the generator from which later episodes draw their seeds."""


class DloEnvironment(gymnasium.Env[dict[str, Any], Float32Array]):
    """A simulated cell in lockstep, observed by its camera, whose robot the caller commands."""

    metadata: ClassVar[dict[str, Any]] = {  # pyright: ignore[reportIncompatibleVariableOverride]
        "render_modes": ["rgb_array"],
        "render_fps": 1,
    }

    def __init__(
        self,
        episodes: Episodes,
        observations: Observations,
        action_space: gymnasium.spaces.Space[Float32Array],
        *,
        reward: Reward,
        max_steps: int,
        privileged: bool,
        render_mode: str | None,
        arguments: object,
    ) -> None:
        """`arguments` identify this environment when a saved state is restored."""
        require_cell("dlokit.gym")
        if reward not in get_args(Reward):
            raise ConfigError(f"reward is {reward!r}; allowed are {' and '.join(get_args(Reward))}.")
        if max_steps < 1:
            raise ConfigError(f"the budget is {max_steps}; it must be at least 1.")
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render_mode is {render_mode!r}; allowed are None and rgb_array.")
        self.action_space = action_space
        self.observation_space = observations.space
        self.render_mode = render_mode
        self._episodes, self._observations = episodes, observations
        self._reward, self._max_steps, self._privileged = reward, max_steps, privileged
        self._fingerprint = hashlib.sha256(repr((type(self).__name__, episodes, arguments)).encode()).hexdigest()
        self._course: EpisodeCourse | None = None
        self._truth: TrueNodes | None = None
        self._goal: GoalShape | None = None
        self._seed, self._options = 0, dict[str, Any]()
        self._taken: list[Float32Array] = []
        self._rmse_m = float("nan")
        self._seen: dict[str, Any] = {}
        self._ended = True
        load_kernels((episodes.config.observer.strategy,))
        load(episodes.config.planning.strategy)

    @abstractmethod
    def _new_course(self, config: RunConfig, job: ShapeJob) -> EpisodeCourse:
        """The course of an episode."""
        ...

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode; with a `seed` it equals the run of `dlokit.shape` with this seed.

        `options` may have ``start`` and ``goal``. An episode that cannot begin, because its start is at its goal
        or cannot be grasped, is drawn again, a few times. Raises `ShapeError` where none can begin.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**31)) if seed is None else seed
        return self._begin(drawn, dict(options or {}))

    def step(self, action: Float32Array) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Execute one action. Success terminates the episode; the budget or a failed component truncates it.

        Raises `BadValue` for numbers that are not finite, and `ResetNeeded` after the end.
        """
        if self._course is None or self._ended:
            raise ResetNeeded("the episode has ended, or none has begun; call reset()")
        vector = np.array(action, dtype=np.float32).reshape(self.action_space.shape)
        if not np.isfinite(vector).all():
            raise BadValue(f"the action is {vector}; give finite numbers from -1 to 1.")
        self._taken.append(vector)
        before_m = self._rmse_m
        try:
            progress = self._course.act(vector)
            self._rmse_m = progress.rmse_m
            self._seen = self._observe(self._course)
        except DlokitError as error:  # a component has failed, or the physics diverged: the episode cannot continue
            progress = StepResult(rmse_m=before_m, outcome=RunOutcome.FAILED, reason=str(error))
        terminated = progress.outcome is RunOutcome.CONVERGED
        truncated = not terminated and (progress.outcome is not None or len(self._taken) >= self._max_steps)
        self._ended = terminated or truncated
        reward = self._reward_of(before_m, progress.rmse_m, reached=terminated)
        return _copied(self._seen), reward, terminated, truncated, self._info(progress, truncated=truncated)

    def render(self) -> UInt8Array | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The scene now (height, width, 3), with the goal (green) and the observed nodes (yellow) drawn in."""
        if self.render_mode is None:
            gymnasium.logger.warn("render() shows nothing without render_mode='rgb_array' in make().")
            return None
        if self._course is None:
            raise ResetNeeded("there is no episode to show; call reset()")
        return self._course.stepped.run(_picture(self._course))

    def close(self) -> None:
        """End the episode and its components."""
        if self._course is not None:
            self._course.stepped.close()
            self._course = None
        self._ended = True

    def save(self) -> EpisodeState:
        """The state of the episode."""
        if self._course is None:
            raise ResetNeeded("there is no episode to save; call reset()")
        return EpisodeState(
            environment=self._fingerprint,
            seed=self._seed,
            options=dict(self._options),
            actions=tuple(vector.copy() for vector in self._taken),
            random=self.np_random.bit_generator.state,
        )

    def restore(self, state: EpisodeState) -> tuple[dict[str, Any], dict[str, Any]]:
        """Bring the environment to a saved state; returns the observation and the info of its last step, or reset.

        The episode is run again from its beginning, which takes as long as its steps did. Raises `ConfigError` for the
        state of an environment with other arguments.
        """
        if state.environment != self._fingerprint:
            raise ConfigError(
                "the state was saved by an environment with other arguments; make one with these arguments."
            )
        seen, info = self._begin(state.seed, dict(state.options))
        for vector in state.actions:
            seen, _, _, _, info = self.step(vector)
        self.np_random.bit_generator.state = dict(state.random)
        return seen, info

    def _begin(self, seed: int, options: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        check_not_forked()
        self.close()
        self._seed, self._options, self._taken = seed, options, []
        why = ""
        draws = self._episodes.draws(options)
        for draw in range(draws):
            course = self._new_course(*self._episodes.job(_redrawn(seed, draw), options))
            try:
                progress = course.begin()
            except BaseException:
                course.stepped.close()
                raise
            if progress.outcome is None:
                return self._begun(course, progress, draw)
            course.stepped.close()
            why = progress.reason or "the start is at the goal"
        raise ShapeError(
            f"No episode of {draws} could begin ({why}). Choose a start that is not at the goal, that does not cross "
            "itself, and that the arm can reach."
        )

    def _begun(self, course: EpisodeCourse, progress: StepResult, draw: int) -> tuple[dict[str, Any], dict[str, Any]]:
        self._course, self._ended, self._rmse_m = course, False, progress.rmse_m
        self._truth = TrueNodes(course.stepped.cell.true_nodes_world, course.first_world)
        self._seen = self._observe(course)
        return _copied(self._seen), {**self._info(progress, truncated=False), "draws": draw + 1}

    def _observe(self, course: EpisodeCourse) -> dict[str, Any]:
        async def observation() -> dict[str, Any]:
            assert self._truth is not None
            transport = course.stepped.system.transport
            self._goal = transport.latest(topics.GOAL).value
            return self._observations.of(transport, self._truth)

        return course.stepped.run(observation())

    def _reward_of(self, before_m: float, after_m: float, *, reached: bool) -> float:
        if self._reward == "sparse":
            return float(reached)
        return (before_m - after_m) / self._episodes.config.task.threshold_m + float(reached)

    def _info(self, progress: StepResult, *, truncated: bool) -> dict[str, Any]:
        outcome = progress.outcome or (RunOutcome.BUDGET if truncated else None)
        info = {
            "is_success": outcome is RunOutcome.CONVERGED,
            "rmse_m": progress.rmse_m,
            "outcome": "" if outcome is None else outcome.value,
            "reason": progress.reason,
            "steps": len(self._taken),
            "seed": self._seed,
            **progress.notes,
        }
        if self._privileged:
            assert self._truth is not None
            assert self._goal is not None, "an episode begins with its goal"
            info[PRIVILEGED_RMSE] = self._truth.rmse_m(self._goal)
        return info


def _redrawn(seed: int, draw: int) -> int:
    """The seed of a draw: at first the given one."""
    return seed if draw == 0 else int(np.random.SeedSequence([seed, draw]).generate_state(1)[0])


def _copied(seen: Mapping[str, Any]) -> dict[str, Any]:
    return {name: np.array(value) for name, value in seen.items()}


async def _picture(course: EpisodeCourse) -> UInt8Array:
    transport = course.stepped.system.transport
    picture = course.stepped.cell.view().copy()
    camera = calibration_of(transport)
    goal, state = transport.latest(topics.GOAL).value, transport.latest(topics.STATE).value
    if camera is not None and goal is not None and state is not None:
        cv2.polylines(picture, [_pixels(picture, goal.nodes_world, camera)[:, None]], False, _GOAL_RGB, 2, cv2.LINE_AA)
        for pixel in _pixels(picture, state.nodes_world, camera):
            cv2.circle(picture, pixel.tolist(), 2, _NODES_RGB, -1, cv2.LINE_AA)
    return picture


def _pixels(picture: UInt8Array, nodes_world: Float64Array, camera: CameraCalibration) -> NDArray[np.int32]:
    """Pixels (M, 2) u, v of nodes (M, 3) [m] in a picture (height, width, 3) of the cell's first camera."""
    size = np.array([picture.shape[1] / camera.width_px, picture.shape[0] / camera.height_px])
    return np.round(project(nodes_world, camera).pixels * size).astype(np.int32)
