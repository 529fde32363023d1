"""Rolls out many motions of a tool on many planning rods in parallel, and settles a released rod.

A rod rests on a level table if friction balances its elastic forces. This depends on one parameter, EI / (μ w), with w
the weight per length. A rod that yields keeps the curvature in excess of its yield curvature.

Every process loads this module for the settings of planning, so compiled code is imported where it is called.
"""

import math
import os
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import scipy

from dlokit import geometry
from dlokit.description.arm.model import Gripper
from dlokit.description.scene import NO_POSTS
from dlokit.description.table import ROLLING_M
from dlokit.rod.believed import POISSON, BelievedDlo, fit_length
from dlokit.types.action import Action, VelocityProfile
from dlokit.types.arrays import Float64Array

_PAD_M = 0.02  # length of the pads along the rod
_EDGE_M = 0.0125  # longest edge: a hanging rod bends too easily where longer ones meet the pads and the table
_DAMPING_S = 0.01
"""Damping of the planning rod [s], less than the DLO's assumed damping: unlike a real rod's, it also resists the
rotation of a bent rod as a whole, and implicit steps add damping of their own."""
SINK_M = 2e-4
"""Penetration of a resting node into the table of the planning rod [m]."""
REST_S = 0.4
"""Simulated time after a release [s]: short, because a decision simulates hundreds of actions."""


def closed_fingers(gripper: Gripper) -> Float64Array:
    """Fingers that push (3,): half the length of their middle line across the tool, radius around it, and how far the
    tips are below the tool [m]."""
    # Rounded to the micrometre, so that widths in decimals give the same line as lengths in decimals.
    half_line_m = round(gripper.pushing_half_width_m - gripper.pad_half_length_m, 6)
    tips_m = gripper.tip_below_tcp_m + gripper.tip_drop_m(0.0)
    return np.array([max(half_line_m, 0.0), gripper.pad_half_length_m, tips_m])


@dataclass(frozen=True, kw_only=True)
class PlanningRod:
    """One variant of the model's rod, within its uncertainty."""

    friction_factor: float = 1.0
    """Ratio of friction and rolling resistance to the model's."""
    stiffness_factor: float = 1.0
    """Ratio of bending and torsional stiffness to the model's."""
    shift_m: tuple[float, float] = (0.0, 0.0)
    """Offset from the estimated position (x, y) [m]: the tool grasps the rod off its centre."""

    yield_curvature_1_m: float | None = None
    """Curvature beyond which it keeps a bend [1/m]; infinite: it always springs back; None: the model's."""

    def numbers(self, config: BelievedDlo, nodes: int) -> Float64Array:
        """The nine numbers (9,) that `simulate_motion` takes, in SI units, for a rod of `nodes` nodes."""
        edge_m = config.length_m / (nodes - 1)
        taken_for = self.yield_curvature_1_m or config.yield_curvature_1_m or math.inf
        bending = self.stiffness_factor * config.bending_stiffness_n_m2
        return np.array(
            [
                edge_m,
                config.mass_kg_m * edge_m,
                bending / edge_m**3,
                bending / (1.0 + POISSON) / (edge_m * config.radius_m**2),
                _DAMPING_S,
                self.friction_factor * config.friction,
                self.friction_factor * ROLLING_M / config.radius_m,
                config.radius_m,
                taken_for,
            ]
        )


UNCERTAINTY = 1.4
"""Factor by which friction and stiffness of a DLO may differ from the model's."""


def rods_around(friction_by: float, stiffness_by: float) -> tuple[PlanningRod, ...]:
    """Four rods with lower and higher friction and stiffness than the model's, by these factors."""
    return tuple(
        PlanningRod(friction_factor=friction, stiffness_factor=stiffness)
        for friction in (1.0 / friction_by, friction_by)
        for stiffness in (1.0 / stiffness_by, stiffness_by)
    )


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion of a tool that grasps a rod, moves and releases it, or pushes it with closed fingers."""

    node: int
    waypoints: Float64Array
    """(W, 4): x, y, z [m], yaw [rad] of the tool, which points down; the first is the grasp."""
    velocity: VelocityProfile
    track: Float64Array | None = None
    """(T, 4): the tool at every time step, if known; the waypoints are then ignored."""
    fingers: Float64Array | None = None
    """The closed fingers that push, as `closed_fingers` returns them; the first waypoint is beside the node. None: the
    fingers hold the node."""
    partner: "Motion | None" = None
    """Simultaneous motion of a second tool; both release when the slower one has arrived."""


@dataclass(frozen=True)
class RolloutResult:
    """Results of all motions on all rods: R rods, C motions."""

    nodes_world: Float64Array  # (R, C, M, 3) [m] final nodes of each rod
    nearest_m: Float64Array  # (R, C) smallest distance of two strands [m]


def simulate(
    config: BelievedDlo,
    nodes_world: Float64Array,
    rods: tuple[PlanningRod, ...],
    motions: tuple[Motion, ...],
    timestep_s: float,
    threads: int = 0,
    *,
    rest_s: float = REST_S,
    posts: Float64Array = NO_POSTS,
) -> RolloutResult:
    """Simulate every motion on every rod, each starting at `nodes_world` (K, 3) [m], among `posts` of a scene (P, 8).

    The simulation goes on for `rest_s` [s] after the release. `threads` 0: one per core; the result does not depend on
    the number.
    """
    from dlokit.rod.planning_rod import Contacts, simulate_motion

    start = fine_rod(config, nodes_world)
    fine = len(start)
    start[:, 2] = config.radius_m - SINK_M
    ends = np.empty((len(rods), len(motions), config.nodes, 3))
    nearest = np.empty((len(rods), len(motions)))
    numbers = [rod.numbers(config, fine) for rod in rods]
    starts = [start + np.array([*rod.shift_m, 0.0]) for rod in rods]
    rest = round(rest_s / timestep_s)

    def one(motion_index: int) -> None:
        motion = motions[motion_index]
        tool = _track(motion, timestep_s)
        end = np.empty_like(start)
        for k, rod in enumerate(numbers):
            if motion.fingers is None:
                contacts = Contacts(tool, pads=_all_pads(starts[k], motion, config.nodes), posts=posts)
            else:
                contacts = Contacts(tool, fingers=motion.fingers, posts=posts)
            nearest[k, motion_index] = simulate_motion(starts[k], rod, timestep_s, rest, contacts, end)
            ends[k, motion_index] = geometry.resample(end, config.nodes)

    with ThreadPoolExecutor(threads or len(os.sched_getaffinity(0))) as pool:
        for _ in pool.map(one, range(len(motions))):
            pass
    ends[..., 2] = np.maximum(ends[..., 2], config.radius_m)
    return RolloutResult(nodes_world=ends, nearest_m=nearest)


def _track(motion: Motion, timestep_s: float) -> Float64Array:
    """The tool (T, 4) at every step; with a partner both tools (T, 8), of which the faster waits for the slower."""
    from dlokit.motion.tool_track import tool_track

    pace, tool = motion.velocity, motion.track
    if tool is None:
        tool = tool_track(motion.waypoints, pace.speed_m_s, pace.acceleration_m_s2, pace.jerk_m_s3, timestep_s)
    if motion.partner is None:
        return tool
    other = _track(motion.partner, timestep_s)
    at = np.arange(max(len(tool), len(other)))
    return np.hstack((tool[np.minimum(at, len(tool) - 1)], other[np.minimum(at, len(other) - 1)]))


def _all_pads(nodes_world: Float64Array, motion: Motion, count: int) -> Float64Array:
    """Points between the pads of a motion's tool and of its partner's, in the form of `Contacts.pads`."""
    held = (motion,) if motion.partner is None else (motion, motion.partner)
    at = [round(one.node * (len(nodes_world) - 1) / (count - 1)) for one in held]
    return np.concatenate([between_pads(nodes_world, at[arm], one.waypoints[0], arm) for arm, one in enumerate(held)])


_PREDICT_STEP_S = 0.01


def predict(
    config: BelievedDlo,
    nodes_world: Float64Array,
    action: Action,
    gripper: Gripper,
    posts: Float64Array = NO_POSTS,
) -> Float64Array:
    """Predict the shape (M, 3) [m] of a rod at `nodes_world` (K, 3) [m] after `action` of an arm with `gripper`.

    `posts` (P, 8) are from `Scene.posts_world`.
    """
    motion = Motion(
        node=action.grasp.node,
        waypoints=waypoints_of(action),
        velocity=action.velocity,
        fingers=None if action.facts.grasps else closed_fingers(gripper),
    )
    rods, step_s = (PlanningRod(),), _PREDICT_STEP_S
    return simulate(config, nodes_world, rods, (motion,), step_s, threads=1, posts=posts).nodes_world[0, 0]


def waypoints_of(action: Action) -> Float64Array:
    """Waypoints (W, 4) of the first arm's tool in an action: x, y, z [m], yaw [rad]."""
    tools = [geometry.matrix(pose) for pose in (action.grasp.T_world_tcp, *action.path)]
    yaws = np.unwrap([math.atan2(T[1, 0], T[0, 0]) for T in tools])
    return np.column_stack(([T[:3, 3] for T in tools], yaws))


def fine_rod(config: BelievedDlo, nodes_world: Float64Array) -> Float64Array:
    """A curve (K, 3) [m] as nodes (F, 3) [m] of a rod of the model's length, with the short edges that the planning rod
    needs. The nodes are on a smooth curve, because straight edges would give the rod kinks."""
    nodes = fit_length(config, nodes_world)
    count = max(config.nodes, math.ceil(config.length_m / _EDGE_M) + 1)
    fraction = np.linspace(0.0, 1.0, len(nodes))
    return np.asarray(scipy.interpolate.CubicSpline(fraction, nodes)(np.linspace(0.0, 1.0, count)), dtype=np.float64)


def between_pads(nodes_world: Float64Array, near: int, tool: Float64Array, arm: int = 0) -> Float64Array:
    """Points of a rod (M, 3) [m] at the ends and the middle of the pads, as `Contacts.pads` (3, 4).

    Tool number `arm`, at `tool` (4,): x, y, z [m], yaw [rad], holds the rod at its node `near`.
    """
    edge_m = float(np.linalg.norm(nodes_world[1] - nodes_world[0]))
    last = len(nodes_world) - 1
    axis = np.array([np.cos(tool[3]), np.sin(tool[3])])
    along = (nodes_world[min(near + 1, last)] - nodes_world[max(near - 1, 0)])[:2]
    sign = 1.0 if along @ axis > 0.0 else -1.0
    held_m = near * edge_m - sign * float((nodes_world[near, :2] - tool[:2]) @ axis)
    at_m = np.clip(held_m + np.array([-0.5, 0.0, 0.5]) * _PAD_M, 0.0, last * edge_m)
    up_m = float(nodes_world[near, 2] - tool[2])
    return np.column_stack((at_m / edge_m, sign * (at_m - held_m), np.full(3, up_m), np.full(3, float(arm))))


_WARMING_STEP_S = 0.02
_SMALL = BelievedDlo(nodes=5, length_m=0.08)


def load_kernels() -> float:
    """Compile or load the planning rod by simulating one short motion; returns the time that it took [s].

    At the first call after an installation Numba compiles, which takes some twenty seconds, and caches the code beside
    the modules, or in the user's cache folder if it cannot write there. Later calls load it.
    """
    began = time.perf_counter()
    lying = np.column_stack((np.linspace(0.0, _SMALL.length_m, _SMALL.nodes), np.zeros((_SMALL.nodes, 2))))
    there_and_up = np.array([[0.04, 0.0, 0.011, 1.5], [0.04, 0.0, 0.03, 1.5], [0.06, 0.0, 0.03, 1.6]])
    motion = Motion(node=2, waypoints=there_and_up, velocity=VelocityProfile())
    simulate(_SMALL, lying, (PlanningRod(),), (motion,), _WARMING_STEP_S, threads=1)
    return time.perf_counter() - began


_AS_MODELLED = PlanningRod()
_SETTLE_S = 2.0  # longest settling time: as long as the evaluator waits
_SETTLE_STEP_S = 0.005  # half of planning's: a goal is tried a few times, not hundreds


def settle(
    config: BelievedDlo,
    nodes_world: Float64Array,
    rod: PlanningRod = _AS_MODELLED,
    posts: Float64Array = NO_POSTS,
) -> Float64Array:
    """Simulate the release of a rod at `nodes_world` (K, 3) [m] until it rests; returns its nodes (M, 3) [m].

    `posts` (P, 8) are from `Scene.posts_world`.

    The rod is assumed to have been straight before the release, and does not collide with itself.
    """
    from dlokit.rod.planning_rod import Contacts, simulate_motion

    nodes = fit_length(config, nodes_world)
    nodes[:, 2] = config.radius_m - SINK_M
    end = np.empty_like(nodes)
    steps = round(_SETTLE_S / _SETTLE_STEP_S)
    simulate_motion(nodes, rod.numbers(config, config.nodes), _SETTLE_STEP_S, steps, Contacts(posts=posts), end)
    end[:, 2] = np.maximum(end[:, 2], config.radius_m)
    return end
