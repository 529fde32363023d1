"""Recorded pictures as a sequence for observers: a bag of ROS as it is published, a folder, or the recording of a run.

Their nodes are not known, but for those of the first frame, by which the cloud is ordered.
"""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import msgspec
import numpy as np

from dlokit.app.data.live_track import perception_alone
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import InputError, NoMorePictures, SkillFailure
from dlokit.extras.bench.observers.sequence import Sequence
from dlokit.functional.cameras.base import Camera
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.following import cleaned
from dlokit.skills.observer.initialise.first_shape import initial_targets
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.pipeline import observe, without_points
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """How the DLO is found in recorded pictures."""

    camera: RecordedCameraConfig = field(default_factory=RecordedCameraConfig)
    """Topics of a bag."""
    segmentation: SegmentationConfig = field(default_factory=BrightnessConfig)


@lru_cache(maxsize=2)
def picture_sequence(path: Path, settings: PictureSettings, frames: int | None) -> Sequence:
    """The clouds of the first `frames` pictures that show the DLO, from the first that can be ordered into nodes on.

    Only the nodes of the first frame are known; the others are NaN. Raises `InputError`.
    """
    camera = replace(settings.camera, path=str(path)).build(MemoryTransport())
    seen: list[Observation] = []
    nodes, why = None, "it has no pictures"
    for look in _looks(camera, settings.segmentation):
        if nodes is None:
            try:
                nodes = initial_targets(cleaned(look), BelievedDlo.nodes, None).nodes_world
            except SkillFailure as failure:
                why = failure.detail
                continue
        seen.append(look)
        if frames is not None and len(seen) == frames:
            break
    if nodes is None or len(seen) < 2:
        raise InputError(
            f"{path}: no two pictures show the DLO ({why}); choose --segmentation and its settings so that it is "
            "found: `dlokit track --camera recorded` shows what they find"
        )
    most = max(len(look.points_world) for look in seen)
    clouds = np.full((len(seen), most, 3), np.nan, dtype=np.float32)
    for frame, look in enumerate(seen):
        clouds[frame, : len(look.points_world)] = look.points_world
    known = np.full((len(seen), *nodes.shape), np.nan)
    known[0] = nodes
    seconds = (seen[-1].stamp_ns - seen[0].stamp_ns) / 1e9
    calibration = seen[0].calibration
    return Sequence(
        name=path.stem,
        rate_hz=(len(seen) - 1) / seconds if seconds > 0.0 else 30.0,
        nodes_world=known,
        radius_m=BelievedDlo.radius_m,
        T_world_camera=None if calibration is None else calibration.T_world_camera,
        clouds_world=clouds,
        calibration=calibration,
    )


def _looks(camera: Camera, segmentation: SegmentationConfig) -> Iterator[Observation]:
    """The cloud of every picture, from which the camera's pose is not corrected."""
    perception = perception_alone(segmentation)
    with camera:
        while True:
            try:
                pictures = asyncio.run(camera.capture(1.0))
            except NoMorePictures:
                return
            try:
                yield observe(pictures, (), perception, segmentation, BelievedDlo.radius_m)
            except SkillFailure:
                yield msgspec.structs.replace(without_points(pictures), stamp_ns=pictures.stamp_ns)
