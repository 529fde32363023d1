"""Learning from actions: the known parameters of simulated rods are recovered."""

import math
from dataclasses import replace
from functools import cache

import msgspec
import numpy as np
import pytest
from made_states import ARM_AT_REST
from msgspec import structs

from dlokit import geometry
from dlokit.description.scene import NO_POSTS
from dlokit.description.shapes import builtin_shape
from dlokit.motion.tool_track import tool_track
from dlokit.rod.believed import BelievedDlo, as_configured, with_belief
from dlokit.rod.posterior import (
    FRICTION_LOG,
    STIFFNESS_LOG,
    YIELDS_1_M,
    Evidence,
    Experience,
    Lesson,
    believed,
    evidence,
    lessons,
    posterior,
)
from dlokit.rod.rollout import Motion, PlanningRod, simulate
from dlokit.skills.model.experiences import GraspLog
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import LogNormal
from dlokit.types.observation import GraspState
from dlokit.types.robot import RobotMode, RobotState

MODEL = BelievedDlo()
I_SHAPE = builtin_shape("I", MODEL.length_m, MODEL.nodes)
S_SHAPE = builtin_shape("S", MODEL.length_m, MODEL.nodes)
STEP_S = 0.005
PACE = VelocityProfile()


def acted(
    rod: PlanningRod,
    before: Float64Array,
    node: int,
    by_m: tuple[float, float],
    turn_rad: float,
    posts: Float64Array = NO_POSTS,
) -> Experience:
    """A rod is grasped at a node, lifted, moved, turned and released."""
    ahead = (before[min(node + 1, 30)] - before[max(node - 1, 0)])[:2]
    grasp = np.array([*before[node, :2], 0.011, math.atan2(ahead[1], ahead[0])])
    way = [(0.0, 0.0, 0.04, 0.0), (*by_m, 0.04, turn_rad), (*by_m, 0.0, turn_rad)]
    waypoints = np.stack([grasp, *(grasp + np.array(step) for step in way)])
    motion = Motion(node=node, waypoints=waypoints, velocity=PACE)
    after = simulate(MODEL, before, (rod,), (motion,), STEP_S, rest_s=1.0, posts=posts).nodes_world[0, 0]
    tool = tool_track(waypoints, PACE.speed_m_s, PACE.acceleration_m_s2, PACE.jerk_m_s3, STEP_S)
    return Experience(
        before_world=before,
        after_world=after,
        node=node,
        times_s=np.linspace(0.0, STEP_S * (len(tool) - 1), len(tool)),
        tool=tool,
    )


ACTIONS = ((7, (0.06, 0.02), 0.6), (30, (-0.05, -0.05), 0.9), (16, (-0.07, 0.0), 0.0))


def history(rod: PlanningRod) -> list[tuple[int, Experience]]:
    shape, found = I_SHAPE, []
    for number, (node, by_m, turn_rad) in enumerate(ACTIONS, start=1):
        found.append((number, acted(rod, shape, node, by_m, turn_rad)))
        shape = found[-1][1].after_world
    return found


@cache
def wire() -> tuple[Lesson, ...]:
    """The belief learned about a stiff rod with permanent deformation."""
    return tuple(lessons(MODEL, history(PlanningRod(stiffness_factor=70.0, yield_curvature_1_m=1.0))))


@pytest.mark.parametrize("stiffness", [1.0, 24.0])
def test_the_elastic_ratio_is_learned_within_its_stated_uncertainty(stiffness: float) -> None:
    rod = PlanningRod(friction_factor=1.2, stiffness_factor=stiffness)
    belief = lessons(MODEL, history(rod))[-1].belief
    true = MODEL.bending_stiffness_n_m2 * stiffness / (MODEL.friction * 1.2 * 9.81 * MODEL.mass_kg_m)
    assert belief.yield_curvature_1_m is None
    low, high = belief.elastic_m3.interval()
    assert low < true < high
    assert belief.elastic_m3.log_sd < math.hypot(0.35, 0.15, 0.25)  # less uncertain than the configured belief
    assert belief.actions == len(ACTIONS)


def test_a_rod_that_keeps_bends_is_distinguished_from_one_that_does_not() -> None:
    found = wire()
    assert found[-1].belief.yield_curvature_1_m == 1.0
    assert found[-1].belief.takes_set > 0.9
    # The belief learned from the first action predicts the second better than the configured one.
    assert found[1].learnt_m < 0.5 * found[1].configured_m


def test_a_rod_that_a_post_stopped_is_explained_by_the_post() -> None:
    place = [float(I_SHAPE[20, 0]) + 0.015, float(I_SHAPE[20, 1]), 0.0]
    posts = np.array([[*place, *place[:2], 0.02, 0.005, 0.3]])
    rod = PlanningRod(friction_factor=1.2, stiffness_factor=4.0)
    seen = acted(rod, I_SHAPE, 28, (0.1, 0.0), 0.0, posts)
    among, blind = evidence(MODEL, seen, posts), evidence(MODEL, seen)
    assert among is not None
    assert blind is not None
    assert among.rmse_m.min() < 0.002 < blind.rmse_m.min()
    informed, misled = lessons(MODEL, [(1, seen)], posts)[0], lessons(MODEL, [(1, seen)])[0]
    assert informed.configured_m < 0.5 * misled.configured_m


def test_an_action_without_motion_gives_no_information() -> None:
    still = Experience(
        before_world=I_SHAPE,
        after_world=I_SHAPE + np.array([0.003, 0.0, 0.0]),
        node=3,
        times_s=np.array([0.0, 1.0]),
        tool=np.zeros((2, 4)),
    )
    assert evidence(MODEL, still) is None
    assert lessons(MODEL, [(1, still)]) == []


def _flat() -> Evidence:
    grid = np.zeros((len(YIELDS_1_M), len(FRICTION_LOG), len(STIFFNESS_LOG)))
    return Evidence(log_likelihood=grid, rmse_m=grid)


def test_without_evidence_the_configured_belief_stays() -> None:
    of = posterior(MODEL, [_flat()])
    belief = believed(MODEL, of, 1, stamp_ns=0)
    assert of.probability.sum() == pytest.approx(1.0)
    assert belief.yield_curvature_1_m is None
    # A very different DLO, mostly a stiffer one, contributes to the mean.
    assert 1.0 < belief.bending_stiffness_n_m2.value / MODEL.bending_stiffness_n_m2 < 1.8
    assert belief.takes_set == pytest.approx(MODEL.belief.takes_set, rel=1e-6)
    springs_back = replace(MODEL, belief=replace(MODEL.belief, takes_set=0.0))
    assert believed(springs_back, posterior(springs_back, [_flat()]), 1, stamp_ns=0).takes_set < 1e-6
    told = replace(MODEL, yield_curvature_1_m=1.0)
    assert believed(told, posterior(told, [_flat()]), 1, stamp_ns=0).yield_curvature_1_m == 1.0


def test_the_model_of_a_belief_has_all_its_parameters() -> None:
    learnt = wire()[-1].belief
    belief = msgspec.structs.replace(
        learnt,
        length_m=LogNormal(value=0.47, log_sd=0.003),
        radius_m=LogNormal(value=0.0031, log_sd=0.02),
        weight_n_m=LogNormal(value=1.2 * learnt.weight_n_m.value, log_sd=0.05),
        bending_stiffness_n_m2=LogNormal(
            value=1.2 * learnt.bending_stiffness_n_m2.value, log_sd=learnt.bending_stiffness_n_m2.log_sd
        ),
    )
    again = as_configured(with_belief(MODEL, belief), stamp_ns=belief.stamp_ns)
    for name in ("length_m", "radius_m", "bending_stiffness_n_m2", "weight_n_m", "friction"):
        found, told = getattr(again, name), getattr(belief, name)
        assert (found.value, found.log_sd) == (pytest.approx(told.value), told.log_sd)
    assert again.yield_curvature_1_m == belief.yield_curvature_1_m
    # The model has the learned EI / (μ w): goals are assessed by it, actions planned with its factors.
    assert again.elastic_m3.value == pytest.approx(belief.elastic_m3.value)


def test_the_model_has_the_learned_probability_of_permanent_bends() -> None:
    belief = msgspec.structs.replace(as_configured(MODEL, 0), takes_set=0.07)
    assert with_belief(MODEL, belief).belief.takes_set == 0.07


def arm(stamp_ns: int, x_m: float, width_m: float = 0.008, holding: bool = True, name: str = "panda") -> RobotState:
    return structs.replace(
        ARM_AT_REST,
        stamp_ns=stamp_ns,
        robot=name,
        T_world_tcp=geometry.downward([x_m, 0.0, 0.011], 0.3),
        finger_width_m=width_m,
        mode=RobotMode.MOVING,
        holding=holding,
    )


def grip(node: int | None, name: str = "panda") -> GraspState:
    return GraspState(stamp_ns=0, robot=name, node=node)


def test_a_grasp_lasts_until_the_fingers_open() -> None:
    grips = GraspLog()
    grips.gripped(grip(5))
    for state in (arm(1, 0.4), arm(2, 0.5), arm(3, 0.6, width_m=0.012, holding=False), arm(4, 0.7, 0.04, False)):
        grips.moved(state)
    grips.gripped(grip(None))
    ended = grips.take()
    assert ended is not None
    seen = ended.experience(I_SHAPE, S_SHAPE)
    assert seen.node == 5
    assert seen.tool[:, 0] == pytest.approx([0.4, 0.5])
    assert seen.tool[:, 3] == pytest.approx(0.3)
    assert grips.take() is None, "a grip is taken once"


def test_a_grasp_that_lost_the_dlo_or_shared_it_gives_no_information() -> None:
    lost = GraspLog()
    lost.gripped(grip(5))
    for state in (arm(1, 0.4), arm(2, 0.5), arm(3, 0.6, width_m=0.0, holding=False)):
        lost.moved(state)
    lost.gripped(grip(None))
    assert lost.take() is None
    shared = GraspLog()
    shared.gripped(grip(5))
    shared.moved(arm(1, 0.4))
    shared.moved(arm(2, 0.5))
    shared.gripped(grip(20, name="second"))
    shared.gripped(grip(None))
    assert shared.take() is None
