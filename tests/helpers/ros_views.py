"""A run as ROS 2 sees it, and what it is fed with in tests."""

from collections.abc import Callable
from typing import Any, cast, get_args

import msgspec
import numpy as np
from made_states import ARM_AT_REST
from scipy.spatial.transform import Rotation

from dlokit import geometry
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.scene import Fixture, Scene
from dlokit.extras.ros2.definitions import definitions_of
from dlokit.extras.ros2.published import outgoing
from dlokit.extras.ros2.published.outgoing import Outgoing, Published
from dlokit.extras.ros2.published.ros_view import RosView
from dlokit.types.action import (
    Action,
    ActionBase,
    Grasp,
    PairPlace,
    Partner,
    VelocityProfile,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, Topology
from dlokit.types.flow import FlowStatus
from dlokit.types.image import CameraCalibration, StereoImages

ROS = definitions_of("jazzy")

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


def view(
    arms: tuple[ArmMount, ...] = FIRST_ALONE,
    fixtures: tuple[Fixture, ...] = (),
    frame: str = outgoing.BASE,
    wanted: Callable[[Published], bool] = lambda row: True,
) -> RosView:
    scene = Scene(arms=arms, fixtures=fixtures)
    return RosView(ROS, lambda stamp_ns: stamp_ns + AHEAD_NS, scene=scene, frame=frame, wanted=wanted)


def of(row: Published, messages: list[Outgoing]) -> list[Any]:
    return [one.message for one in messages if one.row is row]


CAMERA = CameraCalibration(
    width_px=4, height_px=3, fx_px=5.0, fy_px=5.5, cx_px=1.5, cy_px=1.0, T_world_camera=TURNED, baseline_m=0.1
)


def stereo(camera: CameraCalibration = CAMERA) -> StereoImages:
    left = np.arange(36, dtype=np.uint8).reshape(3, 4, 3)
    return StereoImages(stamp_ns=7, left=left, right=left + 1, calibration=camera)


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


def flow(step: str = "approach", **changes: Any) -> FlowStatus:
    return msgspec.structs.replace(FlowStatus(stamp_ns=4, flow="shape_dlo", step=step), **changes)


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


STOPPED = msgspec.structs.replace(ARM_AT_REST, stop_latched=True)
