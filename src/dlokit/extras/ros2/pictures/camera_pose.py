"""The pose of a camera in the world: from a calibration file, or else from TF."""

import contextlib
import logging

from dlokit.extras.ros2.pictures.sources import Moment, PictureSource
from dlokit.extras.ros2.pictures.transforms import NoChain, TransformTree, difference
from dlokit.functional.cameras.calibration_file import pose_from
from dlokit.geometry import compose
from dlokit.types.pose import Pose

log = logging.getLogger(__name__)


class CameraPose:
    """The pose of the file counts; where TF has one as well, the distance of the two is logged once."""

    def __init__(
        self, tree: TransformTree, frame: str, T_world_frame: Pose, file: str, otherwise: Pose | None = None
    ) -> None:
        """`frame` of TF is at `T_world_frame`; `file` is the calibration, empty where there is none.

        `otherwise` counts in place of TF without a file. Raises `ConfigError` when the file has no pose.
        """
        self._tree, self._frame, self._T_world_frame = tree, frame, T_world_frame
        self._file = file
        self._calibrated = pose_from(file) if file else otherwise
        self._compared = not file

    def of(self, source: PictureSource, moment: Moment) -> Pose:
        """T_world_camera for the pictures of a moment.

        Raises `NoChain` where only TF could say it and does not, `HardwareError` for a cloud of which no camera is
        made.
        """
        if self._calibrated is None:
            return self._by_tf(source, moment)
        if not self._compared:
            with contextlib.suppress(NoChain):
                apart = difference(self._calibrated, self._by_tf(source, moment))
                self._compared = True
                where = f"{moment.frame_id} is {apart} away from it"
                log.warning("the camera's pose in %s counts; by TF, %s", self._file, where)
        return self._calibrated

    def _by_tf(self, source: PictureSource, moment: Moment) -> Pose:
        T_frame_pictures = self._tree.lookup(self._frame, moment.frame_id, moment.stamp_ns)
        return compose(self._T_world_frame, compose(T_frame_pictures, source.camera_in_frame(moment)))
