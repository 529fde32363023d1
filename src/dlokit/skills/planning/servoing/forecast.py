"""Predicts, before the arm moves, the error that servoing could remove from the result of an action.

The action is simulated on several plausible rods. In each result the grasp can remove the part of the error that the
Jacobian at the predicted shape reaches. Control follows if that exceeds, on average, the cost of a correction, and
more than the eye could feign.
"""

import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.rod.rollout import Motion, PlanningRod, play, waypoints_of
from dlokit.skills.planning.servoing.controller import DOUBTS, LEAST_GAIN_M, ServoConfig, gain, usual
from dlokit.skills.planning.servoing.jacobian import TIMESTEP_S, Grip, damped_step, jacobian, probes, released, scaled
from dlokit.types.action import Action, ControlForecast
from dlokit.types.arrays import Float64Array

_DOUBT = 1.4  # uncertainty of friction and stiffness of the DLO, as a factor


def foresee(
    model: BelievedDlo,
    nodes_world: Float64Array,
    goal_world: Float64Array,
    action: Action,
    missed_m: float,
    config: ServoConfig,
) -> ControlForecast:
    """Whether control should follow `action` on a rod at `nodes_world` (M, 3) [m] with the goal `goal_world`.

    `missed_m` is the prediction error of earlier actions (RMS) [m], a lower bound of the uncertainty.
    """
    if not action.facts.corrected:
        return ControlForecast(follows=False, gain_m=0.0)
    motion = Motion(node=action.grasp.node, waypoints=waypoints_of(action), velocity=action.velocity)
    shapes = play(model, nodes_world, (PlanningRod(), *_doubtful()), (motion,), TIMESTEP_S).nodes_world[:, 0]
    expected, others = shapes[0], shapes[1:]
    astray_m = float(np.sqrt(np.mean(np.sum((others - expected) ** 2, axis=-1))))
    others = expected + max(1.0, missed_m / max(astray_m, 1e-6)) * (others - expected)
    grip = Grip(motion.node, motion.waypoints[-1])
    matrix = jacobian(released(model, expected, grip, probes()))
    gains_m = [_mendable_m(matrix, (goal_world - shape)[:, :2], config.sight_m) for shape in others]
    gain_m = float(np.mean(gains_m))
    return ControlForecast(follows=gain_m >= LEAST_GAIN_M, gain_m=gain_m)


def _mendable_m(matrix: Float64Array, error: Float64Array, sight_m: float) -> float:
    """RMSE [m] that a correction would remove from an error (M, 2) [m] seen to within `sight_m` [m]; 0 if none."""
    by = (matrix @ scaled(damped_step(matrix, error))).reshape(-1, 2)
    mended = gain(error, by, usual(sight_m, np.ones(len(error), dtype=np.bool_)))
    return mended.rmse_m if mended.exceeds(DOUBTS, LEAST_GAIN_M) else 0.0


def _doubtful() -> tuple[PlanningRod, ...]:
    """Rods that the DLO may be."""
    shares = (1.0 / _DOUBT, _DOUBT)
    return tuple(PlanningRod(friction_share=friction, stiffness_share=stiff) for friction in shares for stiff in shares)
