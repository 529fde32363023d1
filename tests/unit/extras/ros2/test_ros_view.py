"""A run is shown in ROS 2 as its messages say: frames, markers, held nodes and status."""

import dataclasses
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest
from made_fixtures import FURNISHED
from made_states import ARM_AT_REST
from ros_views import (
    CAMERA,
    KINDS,
    ROS,
    SECOND_ARM,
    STOPPED,
    TURNED,
    action_of,
    of,
    points_of,
    rod,
    shown,
    state,
    stereo,
    view,
    xyz,
)
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.communication import topics
from dlokit.description.arm.mounts import FIRST_ALONE, WorkspaceBox, arm_model
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.outgoing import Outgoing, Published
from dlokit.types.action import (
    ActionBase,
    Drag,
    PairPlace,
    PickPlace,
    kind_of,
)
from dlokit.types.dlo import DloBelief, GoalShape, LogNormal
from dlokit.types.flow import FlowStatus, RunOutcome, RunPhase, RunStatus
from dlokit.types.observation import CameraView, GraspState, ObserverEvent, ObserverEventKind


def matrix_of(transform: Any) -> Any:
    xyzw = [getattr(transform.rotation, axis) for axis in "xyzw"]
    position = [getattr(transform.translation, axis) for axis in "xyz"]
    return geometry.homogeneous(Rotation.from_quat(xyzw).as_matrix(), position)


def test_the_frame_of_the_camera_is_corrected_once_perception_has_a_better_pose() -> None:
    run, better = view(), geometry.pose((0.31, -0.2, 0.1), TURNED.wxyz)

    def camera_frames(found: list[Outgoing]) -> list[Any]:
        return [one for message in of(outgoing.TF_STATIC, found) for one in message.transforms[1:]]

    (first,) = camera_frames(run.on(topics.STEREO_IMAGES, stereo()))
    assert (first.header.frame_id, first.child_frame_id) == ("dlokit_world", "dlokit_camera")
    np.testing.assert_allclose(matrix_of(first.transform), geometry.matrix(TURNED), atol=1e-12)
    assert camera_frames(run.on(topics.STEREO_IMAGES, stereo())) == []
    corrected = msgspec.structs.replace(CAMERA, T_world_camera=better)
    (second,) = camera_frames(run.on(topics.CAMERA, CameraView(stamp_ns=8, calibration=corrected)))
    np.testing.assert_allclose(matrix_of(second.transform), geometry.matrix(better), atol=1e-12)
    assert camera_frames(run.on(topics.STEREO_IMAGES, stereo())) == []


def test_joints_have_the_names_of_the_description_and_those_of_a_second_arm_its_name_before() -> None:
    first, second = (
        msgspec.structs.replace(ARM_AT_REST, robot=robot, q_rad=np.arange(7.0)) for robot in ("first", "left")
    )
    arms = (dataclasses.replace(FIRST_ALONE[0], model=arm_model("fr3")), SECOND_ARM)
    run = view(arms=arms)
    (state,) = of(outgoing.JOINTS, run.on(topics.ROBOT_STATE, first))
    assert state.name == [f"fr3_joint{number}" for number in range(1, 8)]
    np.testing.assert_array_equal(state.position, np.arange(7.0))
    (state,) = of(outgoing.JOINTS, run.on(topics.ROBOT_STATE.at("second"), second))
    assert state.name[0] == "left_panda_joint1"


def test_what_is_made_on_demand_is_made_only_where_it_is_wanted() -> None:
    asked: list[Published] = []
    run = view(wanted=lambda row: asked.append(row) or False)
    found = run.on(topics.STEREO_IMAGES, stereo()) + run.on(topics.ROBOT_STATE, ARM_AT_REST)
    assert {one.row for one in found} == {outgoing.TF_STATIC, outgoing.STATUS}
    assert {row.on_demand for row in asked} == {True}


def test_the_sensors_of_the_simulated_arm_are_not_the_robot() -> None:
    assert view().on(topics.ARM_STATE, ARM_AT_REST) == []


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_kind_of_action_is_shown_with_each_arms_descent_and_path(kind: type[ActionBase]) -> None:
    action = action_of(kind)
    found = shown(view().on(topics.ACTION, action))
    arms = [(action.grasp, action.path)] + (
        [] if action.partner is None else [(action.partner.grasp, action.partner.path)]
    )
    assert {key for key in found if key[0] in ("grasp", "path")} == {
        (name, number) for name in ("grasp", "path") for number in range(len(arms))
    }
    for number, (grasp, path) in enumerate(arms):
        descent = xyz(found["grasp", number])
        np.testing.assert_array_equal(descent[1], grasp.T_world_tcp.position_m)
        assert descent[0, 2] > descent[1, 2]
        np.testing.assert_array_equal(
            xyz(found["path", number]), [pose.position_m for pose in (grasp.T_world_tcp, *path)]
        )
    np.testing.assert_array_equal(xyz(found["predicted", 0]), rod())
    assert found["action", 0].text == kind_of(action)


def test_one_array_is_enough_for_a_late_subscriber() -> None:
    run, nodes = view(), rod()
    run.on(topics.STATE, state(nodes))
    run.on(topics.GOAL, GoalShape(stamp_ns=0, nodes_world=nodes + 0.1))
    found = shown(run.on(topics.ACTION, action_of(PickPlace)))
    assert {key[0] for key in found} == {"workspace", "state", "goal", "action", "grasp", "path", "predicted"}
    assert {marker.action for marker in found.values()} == {0}
    assert shown(run.lasting(9)).keys() == found.keys()
    np.testing.assert_array_equal(xyz(found["state", 0]), nodes)
    assert all(marker.pose.orientation.w == 1.0 and marker.color.a > 0.0 for marker in found.values())


def test_the_dlo_is_drawn_as_thick_as_it_is_believed_to_be() -> None:
    run, known = view(), LogNormal(value=1.0)
    belief = DloBelief(
        stamp_ns=0,
        length_m=known,
        radius_m=LogNormal(value=0.002),
        bending_stiffness_n_m2=known,
        weight_n_m=known,
        friction=known,
        elastic_m3=known,
    )
    run.on(topics.BELIEF, belief)
    assert shown(run.on(topics.STATE, state(rod())))["state", 0].scale.x == 0.004


def test_the_workspace_is_a_box_of_twelve_edges() -> None:
    box = WorkspaceBox(lower_m=(0.0, -0.5, 0.0), upper_m=(1.0, 0.5, 0.4))
    found = shown(view(arms=(dataclasses.replace(FIRST_ALONE[0], workspace=box),)).lasting(0))
    edges = xyz(found["workspace", 0]).reshape(12, 2, 3)
    assert {tuple(corner) for corner in edges.reshape(-1, 3).tolist()} == {
        (x, y, z) for x in (0.0, 1.0) for y in (-0.5, 0.5) for z in (0.0, 0.4)
    }
    assert (np.count_nonzero(edges[:, 0] != edges[:, 1], axis=1) == 1).all()


def test_fixtures_are_edges_with_a_name_above_each_and_no_markers_without() -> None:
    found = shown(view(fixtures=FURNISHED.fixtures).lasting(0))
    np.testing.assert_array_equal(xyz(found["fixtures", 0]).reshape(-1, 2, 3), FURNISHED.edges_world)
    names = [found["fixtures", number] for number in (1, 2)]
    assert [one.text for one in names] == ["A", "lid"]
    for one, fixture in zip(names, FURNISHED.fixtures, strict=True):
        place = one.pose.position
        assert (place.x, place.y) == fixture.position_m[:2]
        assert place.z > fixture.top_m
    assert not [key for key in shown(view().lasting(0)) if key[0] == "fixtures"]


def flow(step: str = "approach", **changes: Any) -> FlowStatus:
    return msgspec.structs.replace(FlowStatus(stamp_ns=4, flow="shape_dlo", step=step), **changes)


ENDS = {
    "the action was made": flow("compare", actions=1),
    "the task ended": flow("stalled", outcome=RunOutcome.STALLED),
}


@pytest.mark.parametrize("end", ENDS.values(), ids=ENDS.keys())
def test_an_action_that_has_ended_is_deleted_in_every_array_from_then_on(end: FlowStatus) -> None:
    run = view()
    run.on(topics.FLOW, flow("choose_grasp"))
    before = shown(run.on(topics.ACTION, action_of(PairPlace)))
    assert of(outgoing.MARKERS, run.on(topics.FLOW, flow("approach"))) == []
    ended = shown(run.on(topics.FLOW, end))
    later = shown(run.on(topics.STATE, state(rod())))
    for found in (ended, later):
        gone = {key for key, marker in found.items() if marker.action == 2}
        assert gone == {key for key in before if key[0] in ("action", "grasp", "path", "predicted")}


def test_an_action_takes_the_place_of_the_one_before() -> None:
    run = view()
    run.on(topics.ACTION, action_of(PairPlace))
    found = shown(run.on(topics.ACTION, action_of(Drag, predicted_nodes_world=None)))
    gone = {key for key, marker in found.items() if marker.action == 2}
    assert gone == {("grasp", 1), ("path", 1), ("predicted", 0)}


def test_an_action_that_arrives_before_the_step_of_its_task_stays_shown() -> None:
    run = view()
    run.on(topics.ACTION, action_of(PickPlace))
    assert of(outgoing.MARKERS, run.on(topics.FLOW, flow("grasp", actions=3))) == []


def test_an_action_of_a_task_that_has_ended_is_not_shown_to_one_who_comes_late() -> None:
    run = view()
    run.on(topics.FLOW, flow("converged", outcome=RunOutcome.CONVERGED))
    assert of(outgoing.MARKERS, run.on(topics.ACTION, action_of(PickPlace))) == []


def test_the_nodes_that_all_grippers_hold_are_marked_until_they_are_released() -> None:
    run = view(arms=(*FIRST_ALONE, SECOND_ARM))

    def held(*changes: tuple[str, int | None]) -> list[int]:
        for robot, node in changes:
            run.on(topics.GRIPPED, GraspState(stamp_ns=0, robot=robot, node=node))
        (cloud,) = of(outgoing.DLO, run.on(topics.STATE, state(rod())))
        return np.flatnonzero(points_of(cloud)["held"]).tolist()

    assert held(("first", 2), ("left", 7)) == [2, 7]
    assert held(("first", None)) == [7]


def values(status: Any) -> dict[str, str]:
    return {one.key: one.value for one in status.values}


def test_the_status_is_published_when_it_changes_and_the_last_one_says_everything() -> None:
    run = view()
    (first,) = of(outgoing.STATUS, run.on(topics.RUN, RunStatus(stamp_ns=0, phase=RunPhase.RUNNING)))
    assert values(first)["phase"] == "running"
    run.on(topics.FLOW, flow("choose_grasp", actions=2, rmse_m=0.0123))
    (status,) = of(outgoing.STATUS, run.on(topics.ACTION, action_of(Drag)))
    assert of(outgoing.STATUS, run.on(topics.ROBOT_STATE, ARM_AT_REST)) == []
    assert values(status) == {
        "phase": "running",
        "step": "choose_grasp",
        "action": "3",
        "kind": "drag",
        "rmse_m": "0.012300",
        "outcome": "",
        "reason": "",
        "stop latched": "false",
    }
    (late,) = of(outgoing.STATUS, run.lasting(0))
    assert late == status


def test_a_stop_and_a_lost_dlo_are_said_at_once() -> None:
    run = view()
    (stopped,) = of(outgoing.STATUS, run.on(topics.ROBOT_STATE, STOPPED))
    assert (stopped.level, values(stopped)["stop latched"]) == (2, "true")
    (free,) = of(outgoing.STATUS, run.on(topics.ROBOT_STATE, ARM_AT_REST))
    assert free.level == 0
    lost = ObserverEvent(stamp_ns=0, kind=ObserverEventKind.LOST, reason=None, health=0.0)
    assert of(outgoing.STATUS, run.on(topics.OBSERVER_EVENT, lost))[0].level == 1
    found = msgspec.structs.replace(lost, kind=ObserverEventKind.FOUND_AGAIN)
    assert of(outgoing.STATUS, run.on(topics.OBSERVER_EVENT, found))[0].level == 0


def test_no_random_messages_of_a_run_break_the_view() -> None:
    """Whatever a run publishes: a state of one direction, nodes that are not finite, an action without a path."""
    rng = Random(1)
    run = view()
    for _ in range(20):
        nodes = rod(rng.randrange(99))
        nodes[rng.randrange(len(nodes))] = np.nan
        found = run.on(topics.STATE, state(nodes)) + run.on(topics.ACTION, action_of(PickPlace, path=()))
        assert ("path", 0) not in shown(found)
        for one in found:
            ROS.encode(one.row.kind, one.message)
        assert np.isfinite(xyz(shown(found)["state", 0])).all()
        assert not of(outgoing.DLO, found)[0].is_dense
