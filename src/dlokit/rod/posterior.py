"""Learns the DLO's parameters from actions: Bayes' rule on a grid of friction, stiffness and yield.

The prior is a mixture: the configured DLO or, with a small probability, a very different one, e.g. a wire where a rope
is configured.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.interpolate import RectBivariateSpline

from dlokit import geometry
from dlokit.description.scene import NO_POSTS
from dlokit.rod.believed import BeliefConfig, BelievedDlo, as_configured
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, LogNormal
from dlokit.types.robot import RobotState


@dataclass(frozen=True, kw_only=True)
class Experience:
    """One grasp-to-release during which the gripper held the DLO without interruption."""

    before_world: Float64Array  # (M, 3) [m] at rest
    after_world: Float64Array  # (M, 3) [m] at rest
    node: int
    """The node between the fingers."""
    times_s: Float64Array  # (T,) [s], rising
    tool: Float64Array  # (T, 4) x, y, z [m] and yaw [rad] of the tool from the grasp to the release

    def motion(self, timestep_s: float) -> Motion:
        """The tool's motion for the planning rod, sampled at every time step."""
        steps = max(2, round((self.times_s[-1] - self.times_s[0]) / timestep_s) + 1)
        times_s = np.linspace(self.times_s[0], self.times_s[-1], steps)
        track = np.column_stack([np.interp(times_s, self.times_s, column) for column in self.tool.T])
        return Motion(node=self.node, waypoints=track[[0, -1]], velocity=VelocityProfile(), track=track)

    @property
    def moved_m(self) -> Float64Array:
        """Displacement of each node (M,) [m]."""
        return np.linalg.norm((self.after_world - self.before_world)[:, :2], axis=1)


def tool_of(states: Sequence[RobotState]) -> tuple[Float64Array, Float64Array]:
    """Times (T,) [s] and poses (T, 4) of a tool that points down: x, y, z [m], yaw [rad]. Stamps rise."""
    turns = [geometry.rotation(state.T_world_tcp) for state in states]
    yaw = np.unwrap([np.arctan2(turn[1, 0], turn[0, 0]) for turn in turns])
    places = np.array([state.T_world_tcp.position_m for state in states])
    return np.array([state.stamp_ns / 1e9 for state in states]), np.column_stack((places, yaw))


FRICTION_LOG = np.log(2.0) * np.linspace(-1.0, 1.0, 5)
"""Grid of friction: logarithms of its ratio to the model's, 0.5 to 2."""
STIFFNESS_LOG = np.log(2.0) * np.arange(-2.0, 10.0)
"""Grid of bending stiffness: logarithms of its ratio to the model's, 0.25 to 512."""
YIELDS_1_M = (math.inf, 3.0, 1.0)
"""Grid of yield curvatures [1/m]: a DLO that always springs back, and two that take a set."""
_TIMESTEP_S = 0.005
_REST_S = 1.0  # after the release; longer than in planning, because the camera sees the DLO at rest
_SEEN_M = 0.004  # error of the observed state
_MODEL_FRACTION = 0.08  # error of the planning rod, as a fraction of a node's displacement
_LOW_LIFT_M = 0.05
# Error, as a fraction of the lift: plastic bends out of the plane and turns in the pads are not modelled.
_LIFT_FRACTION = 0.1
_FREEDOM = 3.0  # degrees of freedom of Student's t: one error of the observer does not decide alone
_INDEPENDENT = 5.0  # number of independent nodes with the same information, because the nodes' errors are correlated
_LEAST_MOVED_M = 0.01  # an action that moved less contains only noise


@dataclass(frozen=True)
class Evidence:
    """Evidence of one action for each rod of the grid."""

    log_likelihood: Float64Array  # (Y, F, S) by yield, friction and stiffness
    rmse_m: Float64Array  # (Y, F, S) [m] prediction error of each rod


def evidence(config: BelievedDlo, seen: Experience, posts: Float64Array = NO_POSTS) -> Evidence | None:
    """Simulate an action on every rod of the grid; None when it moved the DLO too little to contain information.

    `posts` (P, 8) are from `Scene.posts_world`.
    """
    if seen.moved_m.max() < _LEAST_MOVED_M:
        return None
    rods = tuple(
        PlanningRod(friction_factor=math.exp(a), stiffness_factor=math.exp(b), yield_curvature_1_m=bend)
        for bend in YIELDS_1_M
        for a in FRICTION_LOG
        for b in STIFFNESS_LOG
    )
    motion = seen.motion(_TIMESTEP_S)
    simulated = simulate(config, seen.before_world, rods, (motion,), _TIMESTEP_S, rest_s=_REST_S, posts=posts)
    residual = np.linalg.norm((simulated.nodes_world[:, 0] - seen.after_world)[..., :2], axis=-1)  # (R, M)
    rmse_m = np.sqrt(np.mean(residual**2, axis=1))
    beyond_m = max(float(np.ptp(seen.tool[:, 2])) - _LOW_LIFT_M, 0.0)
    # An error that no rod of the grid explains is common to all rods: it must not select one of them.
    unexplained_m = math.hypot(_SEEN_M, _LIFT_FRACTION * beyond_m, float(rmse_m.min()))
    sigma = np.hypot(unexplained_m, _MODEL_FRACTION * seen.moved_m)
    square = (residual / sigma) ** 2
    # In the plane Student's t falls by (ν + 2) / 2.
    log_likelihood = -0.5 * (_FREEDOM + 2.0) * np.log1p(square / _FREEDOM).mean(axis=1) * _INDEPENDENT
    grid = (len(YIELDS_1_M), len(FRICTION_LOG), len(STIFFNESS_LOG))
    return Evidence(log_likelihood=log_likelihood.reshape(grid), rmse_m=rmse_m.reshape(grid))


_ANOTHER = 0.2  # prior probability that the DLO is not the configured one
_ANOTHER_STIFFNESS_LOG_SD = 2.5
_ANOTHER_FRICTION_LOG_SD = 0.4
_OTHER_YIELD = 0.2  # prior probability that a DLO declared plastic yields at another curvature, or never
_NO_CHANCE = 1e-12  # probability of a case that is configured as impossible
_MODEL_LOG_SD = 0.1  # the planning rod's model error, which no number of actions removes
_SET_MODEL_LOG_SD = 0.3  # larger uncertainty of a plastic DLO: its strain before an action is not observed
_FINER = 8  # points of the fine grid in one cell of the coarse one


@dataclass(frozen=True)
class Posterior:
    """Probability of each rod: yields Y, frictions F and stiffnesses S on a fine grid."""

    probability: Float64Array  # (Y, F, S), its sum is 1
    friction_log: Float64Array  # (F,) logarithm of the ratio to the model's
    stiffness_log: Float64Array  # (S,) logarithm of the ratio to the model's

    @property
    def best_yield(self) -> int:
        """Index of the most probable yield."""
        return int(self.probability.sum(axis=(1, 2)).argmax())

    @property
    def takes_set(self) -> float:
        """Probability that the DLO takes a set."""
        finite = np.isfinite(np.array(YIELDS_1_M))
        return min(1.0, float(self.probability[finite].sum()))


def posterior(config: BelievedDlo, heard: Sequence[Evidence]) -> Posterior:
    """The posterior given the evidence of all actions."""
    fine_friction, fine_stiffness = _fine(FRICTION_LOG), _fine(STIFFNESS_LOG)
    total = np.zeros((len(YIELDS_1_M), len(FRICTION_LOG), len(STIFFNESS_LOG)))
    for one in heard:
        total += one.log_likelihood
    fine = np.stack(
        [RectBivariateSpline(FRICTION_LOG, STIFFNESS_LOG, layer, kx=2, ky=2)(fine_friction, fine_stiffness)
         for layer in total]
    )  # fmt: skip
    weight = fine + _log_prior(config, fine_friction, fine_stiffness)
    probability = np.exp(weight - weight.max())
    return Posterior(
        probability=probability / probability.sum(), friction_log=fine_friction, stiffness_log=fine_stiffness
    )


def believed(config: BelievedDlo, of: Posterior, actions: int, stamp_ns: int) -> DloBelief:
    """Summarise a posterior as a belief: the most probable yield, and the other parameters' mean and spread for it."""
    layer = of.probability[of.best_yield]
    layer = layer / layer.sum()
    friction, stiffness = _moments(layer, of.friction_log[:, None]), _moments(layer, of.stiffness_log[None, :])
    ratio = _moments(layer, of.stiffness_log[None, :] - of.friction_log[:, None])
    before = as_configured(config, stamp_ns)
    bend = YIELDS_1_M[of.best_yield]
    floor = _MODEL_LOG_SD if math.isinf(bend) else _SET_MODEL_LOG_SD
    return msgspec.structs.replace(
        before,
        # A rod on a table shows only EI / w and μ: the uncertainty of the weight remains in EI.
        bending_stiffness_n_m2=_scaled(
            before.bending_stiffness_n_m2, stiffness, math.hypot(floor, config.belief.weight_log_sd)
        ),
        friction=_scaled(before.friction, friction, floor),
        elastic_m3=_scaled(before.elastic_m3, ratio, floor),
        yield_curvature_1_m=None if math.isinf(bend) else bend,
        takes_set=of.takes_set,
        actions=actions,
    )


def _fine(coarse: Float64Array) -> Float64Array:
    return np.linspace(coarse[0], coarse[-1], _FINER * (len(coarse) - 1) + 1)


def _log_prior(config: BelievedDlo, friction_log: Float64Array, stiffness_log: Float64Array) -> Float64Array:
    """Logarithm of the prior of every rod (Y, F, S), up to a constant."""
    sure: BeliefConfig = config.belief
    a, b = friction_log[:, None], stiffness_log[None, :]
    same = (1.0 - _ANOTHER) * _normal(a, sure.friction_log_sd) * _normal(b, sure.stiffness_log_sd)
    other = _ANOTHER * _normal(a, _ANOTHER_FRICTION_LOG_SD) * _normal(b, _ANOTHER_STIFFNESS_LOG_SD)
    plane = np.log(same + other)
    configured = config.yield_curvature_1_m
    other_yield = sure.takes_set if configured is None else _OTHER_YIELD
    prior = [max(other_yield, _NO_CHANCE) / (len(YIELDS_1_M) - 1)] * len(YIELDS_1_M)
    nearest = 0 if configured is None else int(np.argmin([abs(math.log(bend / configured)) for bend in YIELDS_1_M]))
    prior[nearest] = max(1.0 - other_yield, _NO_CHANCE)
    return np.log(np.array(prior))[:, None, None] + plane


def _normal(log: Float64Array, sd: float) -> Float64Array:
    sd = max(sd, 1e-3)
    return np.exp(-0.5 * (log / sd) ** 2) / sd


def _moments(probability: Float64Array, log: Float64Array) -> tuple[float, float]:
    mean = float((probability * log).sum())
    return mean, math.sqrt(float((probability * (log - mean) ** 2).sum()))


def _scaled(before: LogNormal, log: tuple[float, float], model_log_sd: float) -> LogNormal:
    log_sd = math.hypot(log[1], model_log_sd)
    return LogNormal(value=before.value * math.exp(log[0]), log_sd=log_sd)


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """What one informative action changed."""

    action: int
    """Number of the action in its run, from 1."""
    moved_m: float
    """Largest displacement of a node [m]."""
    configured_m: float
    """Prediction error of the rod as configured (RMSE) [m]."""
    learnt_m: float
    """Prediction error of the rod as learnt from the previous actions [m]."""
    belief: DloBelief
    """The belief after the action."""


def lessons(
    config: BelievedDlo, seen: Iterable[tuple[int, Experience]], posts: Float64Array = NO_POSTS
) -> list[Lesson]:
    """Learn from experiences in their order, among posts (P, 8); those without information are omitted."""
    heard: list[Evidence] = []
    found: list[Lesson] = []
    known = posterior(config, heard)
    configured = _nearest_rod(known)
    for action, experience in seen:
        said = evidence(config, experience, posts)
        if said is None:
            continue
        before = _nearest_rod(known)
        heard.append(said)
        known = posterior(config, heard)
        found.append(
            Lesson(
                action=action,
                moved_m=float(experience.moved_m.max()),
                configured_m=float(said.rmse_m[configured]),
                learnt_m=float(said.rmse_m[before]),
                belief=believed(config, known, len(heard), stamp_ns=round(experience.times_s[-1] * 1e9)),
            )
        )
    return found


def _nearest_rod(of: Posterior) -> tuple[int, int, int]:
    """Indices of the rod of the grid that is nearest to a belief."""
    layer = of.probability[of.best_yield]
    layer = layer / layer.sum()
    friction = float((layer.sum(axis=1) * of.friction_log).sum())
    stiffness = float((layer.sum(axis=0) * of.stiffness_log).sum())
    return (
        of.best_yield,
        int(np.abs(FRICTION_LOG - friction).argmin()),
        int(np.abs(STIFFNESS_LOG - stiffness).argmin()),
    )
