"""What is published in ROS 2: values, frames and order of the messages, for every distribution."""

import dataclasses
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from made_states import ARM_AT_REST
from ros_views import (
    AHEAD_NS,
    CAMERA,
    KINDS,
    ROS,
    SECOND_ARM,
    TURNED,
    action_of,
    flow,
    of,
    points_of,
    rod,
    state,
    stereo,
    view,
)
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.topic import Topic
from dlokit.description.arm.mounts import FIRST_ALONE
from dlokit.description.scene import Scene
from dlokit.extras.ros2.definitions import Definitions, definitions_of
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.diagnostics import LinkFacts, link_diagnosis
from dlokit.extras.ros2.published.outgoing import PUBLISHED, Outgoing
from dlokit.extras.ros2.published.ros_view import RosView
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import GoalShape
from dlokit.types.flow import RunOutcome
from dlokit.types.image import DepthImage, RawCamera
from dlokit.types.message import Message
from dlokit.types.observation import Observation

STAMP = 1_764_336_000_123_456_789


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


def everything(ros: Definitions) -> list[Outgoing]:
    """At least one message of each row of the table."""
    run = RosView(ros, lambda stamp_ns: stamp_ns + AHEAD_NS, scene=Scene())
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
