"""What is published in ROS 2: values, frames and order of the messages, for every distribution."""

import dataclasses
from collections.abc import Callable
from random import Random
from typing import Any, cast, get_args

import msgspec
import numpy as np
import pytest
from made_states import ARM_AT_REST
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.topic import Topic
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount, WorkspaceBox, arm_model
from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.extras.ros2.link.frames import Endpoint, Graph
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.diagnostics import Level, LinkFacts, link_diagnosis, run_diagnosis
from dlokit.extras.ros2.published.outgoing import PUBLISHED, Outgoing, Published
from dlokit.extras.ros2.published.ros_view import RosView
from dlokit.types.action import (
    Action,
    ActionBase,
    Drag,
    Grasp,
    PairPlace,
    Partner,
    PickPlace,
    VelocityProfile,
    kind_of,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloBelief, DloState, GoalShape, LogNormal, Topology
from dlokit.types.flow import FlowStatus, RunOutcome, RunPhase, RunStatus, TaskEnd
from dlokit.types.image import CameraCalibration, DepthImage, RawCamera, StereoImages
from dlokit.types.message import Message
from dlokit.types.observation import CameraView, GraspState, Observation, ObserverEvent, ObserverEventKind
from dlokit.types.robot import RobotMode

ROS = definitions_of("jazzy")
STAMP = 1_764_336_000_123_456_789
AHEAD_NS = 1_764_336_000_000_000_000
"""ROS time minus the run's clock in these tests [ns]."""
NO_EDGES = Topology(edges=np.empty((0, 2), dtype=np.int64), rest_lengths_m=np.empty(0))
SECOND_ARM = ArmMount(robot="left", instance="second", T_world_base=geometry.pose((1.0, 0.0, 0.0)))
TURNED = geometry.pose((0.3, -0.2, 0.1), Rotation.from_euler("z", 1.0).as_quat(scalar_first=True))


def rod(seed: int = 1, count: int = 12) -> Float64Array:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=(count, 3)), axis=0) * 0.02


def state(nodes: Float64Array, **changes: Any) -> DloState:
    return msgspec.structs.replace(DloState(stamp_ns=5, nodes_world=nodes, topology=NO_EDGES), **changes)


def points_of(cloud: Any) -> dict[str, Any]:
    """The columns of a cloud as any reader decodes them: by offset and datatype."""
    assert cloud.row_step == cloud.point_step * cloud.width
    assert len(cloud.data) == cloud.row_step * cloud.height
    rows = cloud.data.reshape(cloud.width, cloud.point_step)
    assert all(field.datatype == 7 and field.count == 1 for field in cloud.fields)  # FLOAT32
    return {
        field.name: np.ascontiguousarray(rows[:, field.offset : field.offset + 4]).view("<f4")[:, 0]
        for field in cloud.fields
    }


def test_the_cloud_has_the_nodes_in_order_with_std_visible_and_held() -> None:
    nodes, rng = rod(), np.random.default_rng(2)
    spread = rng.uniform(1e-3, 1e-2, size=(len(nodes), 3))
    covariance = np.array([np.diag(row**2) for row in spread])
    visible = rng.random(len(nodes)) < 0.5
    cloud = outgoing.dlo_cloud(ROS, STAMP, state(nodes, covariance=covariance, visible=visible), [3, 99])
    found = points_of(cloud)
    assert list(found) == ["x", "y", "z", "std", "visible", "held"]
    np.testing.assert_array_equal(np.column_stack([found[axis] for axis in "xyz"]), nodes.astype(np.float32))
    np.testing.assert_allclose(found["std"], np.sqrt(np.mean(spread**2, axis=1)), rtol=1e-6)  # float32
    np.testing.assert_array_equal(found["visible"], visible)
    np.testing.assert_array_equal(np.flatnonzero(found["held"]), [3])
    assert cloud.is_dense
    assert (cloud.header.frame_id, cloud.header.stamp.sec) == ("dlokit_world", 1_764_336_000)
    assert cloud.header.stamp.nanosec == 123_456_789


def test_without_a_covariance_std_is_nan_and_nothing_is_visible_before_the_first_look() -> None:
    found = points_of(outgoing.dlo_cloud(ROS, STAMP, state(rod())))
    assert np.isnan(found["std"]).all()
    assert not found["visible"].any()


def test_the_colour_of_a_point_is_packed_as_rviz_reads_it() -> None:
    cloud = outgoing.seen_cloud(ROS, STAMP, np.zeros((1, 3), dtype=np.float32), np.array([[1, 2, 3]], dtype=np.uint8))
    assert points_of(cloud)["rgb"].view(np.uint32).tolist() == [0x010203]
    assert list(points_of(outgoing.seen_cloud(ROS, STAMP, np.zeros((0, 3), dtype=np.float32)))) == ["x", "y", "z"]


def matrices(poses: list[Any]) -> Any:
    xyzw = [[getattr(pose.orientation, axis) for axis in "xyzw"] for pose in poses]
    np.testing.assert_allclose(np.linalg.norm(xyzw, axis=1), 1.0, atol=1e-12)
    return Rotation.from_quat(xyzw).as_matrix()


@pytest.mark.parametrize("seed", range(20))
def test_the_x_axis_is_along_the_dlo_and_no_rotation_about_it_has_a_higher_z_axis(seed: int) -> None:
    nodes = rod(seed)
    R = matrices(outgoing.pose_array(ROS, STAMP, nodes).poses)
    along = geometry.tangents(nodes)
    np.testing.assert_allclose(R[:, :, 0], along, atol=1e-9)
    # The highest z that is across the DLO: its height is the sine of the angle to the vertical.
    np.testing.assert_allclose(R[:, 2, 2], np.hypot(along[:, 0], along[:, 1]), atol=1e-9)


def test_a_vertical_part_keeps_the_side_of_its_neighbours() -> None:
    up = np.array([[0.0, 0.0, 0.01 * step] for step in range(5)])
    nodes = np.vstack([[[-0.02, 0.0, 0.0], [-0.01, 0.0, 0.0]], up])
    R = matrices(outgoing.pose_array(ROS, STAMP, nodes).poses)
    np.testing.assert_allclose(R[4, :, 0], [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(R[:, :, 1], np.tile([0.0, 1.0, 0.0], (len(nodes), 1)), atol=1e-12)


@pytest.mark.parametrize("nodes", [np.outer(np.arange(4), [0.0, 0.0, 0.1]), np.zeros((4, 3))])
def test_a_dlo_without_any_horizontal_direction_has_poses_as_well(nodes: Float64Array) -> None:
    R = matrices(outgoing.pose_array(ROS, STAMP, nodes).poses)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


def test_the_goal_is_a_path_of_its_nodes() -> None:
    nodes = rod()
    path = outgoing.goal_path(ROS, STAMP, nodes)
    found = [[getattr(one.pose.position, axis) for axis in "xyz"] for one in path.poses]
    np.testing.assert_array_equal(found, nodes)
    assert {one.header.frame_id for one in path.poses} == {"dlokit_world"}


def test_tf_has_the_world_in_the_base_of_the_first_arm() -> None:
    arms = (dataclasses.replace(FIRST_ALONE[0], T_world_base=TURNED), SECOND_ARM)
    (static,) = [one for one in view(arms=arms, frame="fr3_link0").lasting(0) if one.row is outgoing.TF_STATIC]
    (transform,) = static.message.transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("fr3_link0", "dlokit_world")
    np.testing.assert_allclose(matrix_of(transform.transform) @ geometry.matrix(TURNED), np.eye(4), atol=1e-12)


def matrix_of(transform: Any) -> Any:
    xyzw = [getattr(transform.rotation, axis) for axis in "xyzw"]
    position = [getattr(transform.translation, axis) for axis in "xyz"]
    return geometry.homogeneous(Rotation.from_quat(xyzw).as_matrix(), position)


def view(
    arms: tuple[ArmMount, ...] = FIRST_ALONE,
    frame: str = outgoing.BASE,
    wanted: Callable[[Published], bool] = lambda row: True,
) -> RosView:
    return RosView(ROS, lambda stamp_ns: stamp_ns + AHEAD_NS, arms=arms, frame=frame, wanted=wanted)


def of(row: Published, messages: list[Outgoing]) -> list[Any]:
    return [one.message for one in messages if one.row is row]


CAMERA = CameraCalibration(
    width_px=4, height_px=3, fx_px=5.0, fy_px=5.5, cx_px=1.5, cy_px=1.0, T_world_camera=TURNED, baseline_m=0.1
)


def stereo(camera: CameraCalibration = CAMERA) -> StereoImages:
    left = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
    return StereoImages(stamp_ns=7, left=left, right=left + 1, calibration=camera)


def test_a_picture_has_its_pixels_in_rows() -> None:
    pictures = stereo()
    found = view().on(topics.STEREO_IMAGES, pictures)
    (left,), (right,) = of(outgoing.LEFT, found), of(outgoing.RIGHT, found)
    assert (left.encoding, left.height, left.width, left.step) == ("rgb8", 3, 4, 12)
    np.testing.assert_array_equal(left.data.reshape(3, 4, 3), pictures.left)
    np.testing.assert_array_equal(right.data.reshape(3, 4, 3), pictures.right)
    assert left.header.frame_id == "dlokit_camera"
    assert left.header.stamp.nanosec == 7
    grey = outgoing.image(ROS, STAMP, np.zeros((3, 4), dtype=np.uint8))
    assert (grey.encoding, grey.step) == ("mono8", 4)


def test_an_unknown_depth_is_nan() -> None:
    depth = np.array([[0.0, 0.5]], dtype=np.float32)
    picture = np.zeros((1, 2, 3), dtype=np.uint8)
    camera = msgspec.structs.replace(CAMERA, baseline_m=None)
    found = view().on(topics.DEPTH_IMAGES, DepthImage(stamp_ns=0, pixels=picture, depth_m=depth, calibration=camera))
    (depths,) = of(outgoing.DEPTHS, found)
    assert depths.encoding == "32FC1"
    np.testing.assert_array_equal(depths.data.view("<f4"), np.array([np.nan, 0.5], dtype=np.float32))
    assert len(of(outgoing.COLOUR, found)) == len(of(outgoing.COLOUR_INFO, found)) == 1
    assert len(of(outgoing.DEPTHS_INFO, found)) == 1


def test_the_projection_of_the_right_camera_is_shifted_by_the_baseline() -> None:
    found = view().on(topics.STEREO_IMAGES, stereo())
    (left,), (right,) = of(outgoing.LEFT_INFO, found), of(outgoing.RIGHT_INFO, found)
    point = np.array([0.2, 0.1, 2.0, 1.0])  # in the frame of the left camera
    for info, x in ((left, 0.2), (right, 0.2 - 0.1)):
        u, v, w = info.p.reshape(3, 4) @ point
        np.testing.assert_allclose([u / w, v / w], [5.0 * x / 2.0 + 1.5, 5.5 * 0.1 / 2.0 + 1.0])


@pytest.mark.parametrize(
    ("coefficients", "model", "count"), [(0, "plumb_bob", 5), (4, "plumb_bob", 5), (8, "rational_polynomial", 8)]
)
def test_the_distortion_has_the_name_that_ros_knows(coefficients: int, model: str, count: int) -> None:
    lens = np.linspace(0.01, 0.02, coefficients).astype(np.float32) if coefficients else None
    info = outgoing.camera_info(ROS, STAMP, msgspec.structs.replace(CAMERA, distortion=lens))
    assert (info.distortion_model, len(info.d)) == (model, count)
    np.testing.assert_allclose(info.d[:coefficients], [] if lens is None else lens)
    np.testing.assert_array_equal(info.d[coefficients:], 0.0)
    np.testing.assert_array_equal(info.r.reshape(3, 3), np.eye(3))


def test_the_calibration_of_a_pair_that_is_not_parallel_turns_into_the_rectified_frame() -> None:
    turn = Rotation.from_euler("y", 0.1)
    raw = RawCamera(
        fx_px=6.0,
        fy_px=6.5,
        cx_px=2.0,
        cy_px=1.0,
        wxyz=turn.as_quat(scalar_first=True),
        distortion=np.zeros(5, dtype=np.float32),
    )
    info = outgoing.camera_info(ROS, STAMP, msgspec.structs.replace(CAMERA, raw_left=raw, raw_right=raw))
    np.testing.assert_allclose(info.r.reshape(3, 3), turn.as_matrix(), atol=1e-12)
    np.testing.assert_array_equal(info.k, [6.0, 0.0, 2.0, 0.0, 6.5, 1.0, 0.0, 0.0, 1.0])
    assert (info.p[0], info.p[5]) == (5.0, 5.5)


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


GRASP = Grasp(node=2, T_world_tcp=geometry.downward((0.4, 0.1, 0.01), 0.3))
PATH = tuple(geometry.downward((0.4 + 0.1 * step, 0.1, 0.05), 0.3) for step in range(1, 4))
PARTNER = Partner(
    robot="left",
    grasp=Grasp(node=9, T_world_tcp=geometry.downward((0.6, -0.1, 0.01), 0.0)),
    path=PATH[:1],
    velocity=VelocityProfile(),
)


def action_of(kind: type[ActionBase], **changes: Any) -> Any:
    action = kind(
        stamp_ns=3,
        grasp=GRASP,
        path=PATH,
        velocity=VelocityProfile(),
        predicted_nodes_world=rod(),
        partner=PARTNER if kind is PairPlace else None,
    )
    return msgspec.structs.replace(action, **changes)


KINDS = cast(tuple[type[ActionBase], ...], get_args(Action))


def shown(messages: list[Outgoing]) -> dict[tuple[str, int], Any]:
    """The markers of the last array, by namespace and id, each of which is unique."""
    markers = of(outgoing.MARKERS, messages)[-1].markers
    found = {(marker.ns, marker.id): marker for marker in markers}
    assert len(found) == len(markers)
    return found


def xyz(marker: Any) -> Any:
    return np.array([[getattr(point, axis) for axis in "xyz"] for point in marker.points])


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


def test_a_process_that_starts_after_the_task_knows_its_end() -> None:
    end = TaskEnd(
        number=1,
        goal="S",
        outcome=RunOutcome.STALLED,
        text="no better\nshape",
        actions=4,
        rmse_m=0.02,
        threshold_m=0.01,
    )
    found = run_diagnosis(run=RunStatus(stamp_ns=0, phase=RunPhase.WAITING, last=end))
    assert (found.level, found.text) == (Level.WARN, "stalled: no better shape")
    assert dict(found.values)["outcome"] == "stalled"
    assert dict(found.values)["action"] == "4"


STOPPED = msgspec.structs.replace(ARM_AT_REST, stop_latched=True)
BROKEN = msgspec.structs.replace(ARM_AT_REST, mode=RobotMode.FAULT)


@pytest.mark.parametrize(
    ("known", "level", "text"),
    [
        ({}, Level.OK, "no task has begun"),
        ({"flow": flow("grasp", rmse_m=0.05)}, Level.OK, "grasp, 0 actions, RMSE 50.0 mm"),
        ({"flow": flow("converged", actions=1, outcome=RunOutcome.CONVERGED)}, Level.OK, "converged after 1 action"),
        ({"flow": flow("stalled", outcome=RunOutcome.STALLED, text="why")}, Level.WARN, "stalled: why"),
        ({"flow": flow("failed", outcome=RunOutcome.FAILED, text="why")}, Level.ERROR, "failed: why"),
        ({"flow": flow("grasp"), "lost": True}, Level.WARN, "the observer has lost the DLO"),
        (
            {"run": RunStatus(stamp_ns=0, phase=RunPhase.ASKING, asks="move")},
            Level.OK,
            "waits until the operator allows",
        ),
        ({"run": RunStatus(stamp_ns=0, phase=RunPhase.WAITING)}, Level.OK, "waiting"),
        ({"robots": (BROKEN,)}, Level.ERROR, "arm first has stopped itself and must recover"),
        ({"robots": (STOPPED,), "flow": flow("grasp")}, Level.ERROR, "stopped by a person: arm first"),
    ],
)
def test_the_level_of_the_status_has_its_reason(known: dict[str, Any], level: Level, text: str) -> None:
    found = run_diagnosis(**known)
    assert found.level is level
    assert found.text.startswith(text)


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


def reader(row: Published, **changes: Any) -> Endpoint:
    same = Endpoint(node="/rviz", type=row.kind, reliable=True, transient_local=row.transient_local)
    return msgspec.structs.replace(same, **changes)


@pytest.mark.parametrize(
    ("row", "changes", "level", "said"),
    [
        (outgoing.DLO, {}, Level.OK, ""),
        (outgoing.DLO, {"reliable": False}, Level.OK, "may lose messages: it asks for reliability best effort"),
        (outgoing.DLO, {"transient_local": True}, Level.WARN, "gets nothing: it asks for durability transient local"),
        (outgoing.GOAL, {"transient_local": False}, Level.OK, "gets no message before the next"),
        (outgoing.GOAL, {"type": "nav_msgs/msg/Odometry"}, Level.WARN, "gets nothing: it reads nav_msgs/msg/Odometry"),
    ],
)
def test_a_reader_that_asks_for_something_else_is_named(
    row: Published, changes: dict[str, Any], level: Level, said: str
) -> None:
    graph = Graph(topics={}, publishers={}, subscriptions={row.topic: [reader(row, **changes)]})
    found = link_diagnosis(LinkFacts(graph=graph), PUBLISHED)
    assert found.level is level
    named = dict(found.values).get(f"reader /rviz on {outgoing.absolute(row.topic)}", "")
    assert named.startswith(said)
    assert bool(named) == bool(said)


def test_dropped_messages_and_topics_that_the_node_lacks_are_a_warning() -> None:
    found = link_diagnosis(LinkFacts(dropped=3, clock_offset_ns=-2_000_000, lacks={"~/goal": "no nav_msgs"}), PUBLISHED)
    assert found.level is Level.WARN
    assert "3 messages were dropped" in found.text
    assert "~/goal: no nav_msgs" in found.text
    assert dict(found.values)["clock offset s"] == "-0.002000"


def everything(ros: Definitions) -> list[Outgoing]:
    """At least one message of each row of the table."""
    run = RosView(ros, lambda stamp_ns: stamp_ns + AHEAD_NS, arms=FIRST_ALONE)
    picture = np.zeros((3, 4, 3), dtype=np.uint8)
    depth = np.ones((3, 4), dtype=np.float32)
    fed: list[tuple[Topic[Any], Message]] = [
        (topics.STATE, state(rod())),
        (topics.GOAL, GoalShape(stamp_ns=0, nodes_world=rod(2))),
        (topics.OBSERVATION, Observation(stamp_ns=0, points_world=rod(3).astype(np.float32))),
        (topics.ROBOT_STATE, ARM_AT_REST),
        (topics.STEREO_IMAGES, stereo()),
        (topics.DEPTH_IMAGES, DepthImage(stamp_ns=0, pixels=picture, depth_m=depth, calibration=CAMERA)),
        *((topics.ACTION, action_of(kind)) for kind in KINDS),
        (topics.FLOW, flow("converged", outcome=RunOutcome.CONVERGED)),
    ]
    found = run.lasting(0)
    for topic, message in fed:
        found += run.on(topic, message)
    link = link_diagnosis(LinkFacts(), PUBLISHED)
    return [*found, run.diagnostics(0, [link]), *run.lasting(9)]


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted", "lyrical"])
def test_every_message_is_the_same_after_encoding_and_decoding_in_every_distribution(distribution: str) -> None:
    ros = definitions_of(distribution)
    messages = everything(ros)
    assert {one.row for one in messages} == set(PUBLISHED)
    for one in messages:
        assert_equal(one.message, ros.decode(one.row.kind, ros.encode(one.row.kind, one.message)), one.row.topic)


def assert_equal(sent: Any, got: Any, where: str) -> None:
    if dataclasses.is_dataclass(sent):
        assert type(sent) is type(got), where
        for field in dataclasses.fields(sent):
            assert_equal(getattr(sent, field.name), getattr(got, field.name), f"{where}.{field.name}")
    elif isinstance(sent, list):
        sent, got = cast(list[Any], sent), cast(list[Any], got)
        assert len(sent) == len(got), where
        for number, (a, b) in enumerate(zip(sent, got, strict=True)):
            assert_equal(a, b, f"{where}[{number}]")
    elif isinstance(sent, np.ndarray):
        np.testing.assert_array_equal(sent, got, err_msg=where)
    elif isinstance(sent, float):
        np.testing.assert_allclose(got, sent, rtol=1e-6, err_msg=where)  # colours are float32
    else:
        assert sent == got, where


def test_the_table_names_each_topic_once_and_keeps_one_message_for_late_subscribers() -> None:
    assert len({row.topic for row in PUBLISHED}) == len(PUBLISHED)
    assert {row.depth for row in PUBLISHED if row.transient_local} == {1}
    assert all(ROS.knows(row.kind) and row.doc for row in PUBLISHED)


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
