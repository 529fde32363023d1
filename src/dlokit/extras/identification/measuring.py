"""Measure length and radius of a DLO in pictures of a run in which it is free and not hidden by the arm."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.communication import topics
from dlokit.description.arm.model import ArmModel
from dlokit.errors import SkillFailure
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.recording.reader import Recorded
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.pipeline import Look, corrected_camera_pose, perceive
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import LogNormal
from dlokit.types.flow import FlowStatus
from dlokit.types.image import CameraPictures, DepthImage, StereoImages
from dlokit.types.robot import RobotState


def radius_m(look: Look, nodes_world: Float64Array) -> float | None:
    """Radius [m] of a DLO with the centre line `nodes_world` (M, 3) [m], tip to tip; None if no pixel shows it.

    A thin round rod at an angle a to the line of sight covers an area of 2 r sin(a) per metre; a pixel
    at depth Z covers (Z / f)². The mask must show the whole DLO.
    """
    camera = look.observation.calibration
    if camera is None or not look.mask.any():
        return None
    edges = np.diff(nodes_world, axis=0)
    view = 0.5 * (nodes_world[1:] + nodes_world[:-1]) - camera.T_world_camera.position_m
    distance_m = np.linalg.norm(view, axis=1)
    across_m = np.linalg.norm(np.cross(edges, view), axis=1) / distance_m
    focal_px = float(np.sqrt(camera.fx_px * camera.fy_px))
    # The width in pixels is assumed constant: the depth varies by a few percent along the DLO.
    width_px = float(look.mask.sum()) / float((across_m * focal_px / distance_m).sum())
    return 0.5 * width_px * float(np.average(distance_m, weights=across_m)) / focal_px


_FREE = frozenset({"find_dlo", "track_model", "track_again"})  # steps of the flow in which the DLO lies free
_MOST_LOOKS = 6
_NODES = 61
# Errors common to all pictures, measured over lengths of 0.4 to 0.65 m and radii of 2 to 6 mm (standard deviations).
_LENGTH_LOG_SD = 0.012
_RADIUS_LOG_SD = 0.035


@dataclass(frozen=True, kw_only=True)
class Measures:
    """The size of the DLO as measured by the camera."""

    length_m: LogNormal
    radius_m: LogNormal
    looks: int


def measure(messages: Iterable[Recorded], config: PerceptionConfig, dlo: BelievedDlo, arm: ArmModel) -> Measures | None:
    """Measure in the first pictures that show the whole DLO free on the table; None if there are none.

    `dlo` is the prior belief, `arm` the model of the arm in the pictures.
    """
    lengths: list[float] = []
    radii: list[float] = []
    for images, robot in _free_pictures(messages):
        size = _size(images, PosedArm(arm, robot), config, dlo)
        if size is not None:
            lengths.append(size[0])
            radii.append(size[1])
        if len(lengths) == _MOST_LOOKS:
            break
    if not lengths:
        return None
    return Measures(
        length_m=_figure(lengths, _LENGTH_LOG_SD), radius_m=_figure(radii, _RADIUS_LOG_SD), looks=len(lengths)
    )


def _free_pictures(messages: Iterable[Recorded]) -> Iterator[tuple[CameraPictures, RobotState]]:
    step, robot = "", None
    for recorded in messages:
        match recorded.message:
            case FlowStatus() as status:
                step = status.step
            case RobotState() as state if recorded.topic == topics.ROBOT_STATE.name:
                robot = state
            case (StereoImages() | DepthImage()) as images if step in _FREE and robot is not None:
                yield images, robot
            case _:
                pass


def _size(
    images: CameraPictures, robot: PosedArm, config: PerceptionConfig, dlo: BelievedDlo
) -> tuple[float, float] | None:
    """Length and radius [m] in the pictures of one look; None if the DLO is not completely visible."""
    if config.table.correct_pose:
        pose = corrected_camera_pose(images, (robot,), config, config.segmentation)
        if pose is not None:
            calibration = msgspec.structs.replace(images.calibration, T_world_camera=pose)
            images = msgspec.structs.replace(images, calibration=calibration)
    try:
        look = perceive(images, (robot,), config, config.segmentation, dlo.radius_m)
        nodes = initial_targets(look.observation, _NODES, None, radius_m=dlo.radius_m).nodes_world
    except SkillFailure:
        return None
    radius = radius_m(look, nodes)
    return None if radius is None else (float(geometry.arc_lengths(nodes)[-1]), radius)


def _figure(values: list[float], common_log_sd: float) -> LogNormal:
    logs = np.log(values)
    scatter = float(logs.std()) / math.sqrt(len(values))
    return LogNormal(value=float(np.exp(np.median(logs))), log_sd=math.hypot(common_log_sd, scatter))
