"""Effects of actions are compared with their predictions."""

import msgspec
import numpy as np
import pytest

from dlokit.description.shapes import builtin_shape
from dlokit.rod.believed import BelievedDlo, topology
from dlokit.skills.planning.rollout.score import PredictionErrors
from dlokit.types.action import Action, Drag, Grasp, LayDown, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState
from dlokit.types.pose import Pose

MODEL = BelievedDlo()
I_SHAPE = builtin_shape("I", MODEL.length_m, MODEL.nodes)
S_SHAPE = builtin_shape("S", MODEL.length_m, MODEL.nodes)
ASIDE = np.array([0.03, 0.0, 0.0])


def state(nodes: Float64Array, stamp_ns: int) -> DloState:
    return DloState(stamp_ns=stamp_ns, nodes_world=nodes, topology=topology(MODEL))


def laid() -> Action:
    pose = Pose(position_m=np.zeros(3), wxyz=np.array([0.0, 1.0, 0.0, 0.0]))
    return LayDown(
        stamp_ns=1,
        grasp=Grasp(node=0, T_world_tcp=pose),
        path=(pose,),
        velocity=VelocityProfile(),
        predicted_nodes_world=S_SHAPE,
    )


def after(action: Action, nodes: Float64Array, stamp_ns: int = 2) -> PredictionErrors:
    misses = PredictionErrors(MODEL)
    misses.expect(action, state(I_SHAPE, 1))
    misses.compare(state(nodes, stamp_ns))
    return misses


def test_a_large_prediction_error_affects_only_actions_of_its_kind() -> None:
    misses = after(laid(), S_SHAPE + ASIDE)
    assert misses.of(LayDown) == pytest.approx(np.sqrt((LayDown.facts.usual_error_m**2 + 0.03**2) / 2.0))
    assert misses.of(Drag) == Drag.facts.usual_error_m


def test_a_small_prediction_error_lowers_the_expected_error_of_its_kind() -> None:
    assert after(laid(), S_SHAPE).of(LayDown) < LayDown.facts.usual_error_m


def test_a_repeated_proposal_and_an_unmoved_rod_change_nothing() -> None:
    assert after(laid(), S_SHAPE + ASIDE, stamp_ns=1).of(LayDown) == LayDown.facts.usual_error_m
    assert after(laid(), I_SHAPE).of(LayDown) == LayDown.facts.usual_error_m


def test_of_several_proposals_the_last_was_executed() -> None:
    misses = PredictionErrors(MODEL)
    misses.expect(laid(), state(I_SHAPE, 1))
    misses.expect(msgspec.structs.replace(laid(), predicted_nodes_world=S_SHAPE + ASIDE), state(I_SHAPE, 1))
    misses.compare(state(S_SHAPE + ASIDE, 2))
    assert misses.of(LayDown) < LayDown.facts.usual_error_m
