"""Calibration in the frames of an installation.

A calibration is fitted in the world frame, which is on the table. Poses of an arm in a folder are in that arm's base
frame, as its controller reports them; the pose of a camera in a file is in the installation's frame. Without an
installation file all three frames are the same.
"""

from dataclasses import replace
from pathlib import Path

import msgspec

from dlokit import geometry
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.installation import PAPERS_CELL, Installation
from dlokit.functional.cameras.strategies import AnyCamera
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_file import with_installation
from dlokit.types.image import CameraCalibration
from dlokit.types.pose import Pose


class CalibratedInstallation:
    """The installation of `--installation`, or the default one."""

    def __init__(self, file: Path | None) -> None:
        """Read `file`. Raises `ConfigError`, which names file and key."""
        run = RunConfig() if file is None else with_installation(RunConfig(), file)
        self.installation: Installation = PAPERS_CELL if file is None else run.installation
        self.camera: AnyCamera = run.camera
        """The driver of its camera, with its settings."""

    @property
    def arm(self) -> ArmMount:
        """The arm that holds the board. Raises `ConfigError` or `MachineError` as `Installation.mounts` does."""
        return FIRST_ALONE[0] if self.installation is PAPERS_CELL else self.installation.mounts(1)[0]

    def cell(self, run: RunConfig) -> RunConfig:
        """The simulated cell of a calibration, set up like the installation; its arm must be valid at home."""
        run = replace(run, installation=self.installation, camera=self.camera)
        if self.installation is not PAPERS_CELL:
            from dlokit.system.configuration.installation_checks import check_installation

            check_installation(run)
        return run

    def base_to_world(self, T_base_tcp: Pose) -> Pose:
        """A pose that the arm reports, in the world."""
        T_world_base = self.arm.T_world_base
        return T_base_tcp if T_world_base is None else geometry.compose(T_world_base, T_base_tcp)

    def world_to_base(self, T_world_tcp: Pose) -> Pose:
        """The reverse."""
        T_world_base = self.arm.T_world_base
        return T_world_tcp if T_world_base is None else geometry.compose(geometry.inverse(T_world_base), T_world_tcp)

    def read(self, camera: CameraCalibration) -> CameraCalibration:
        """A calibration of a file, its pose in the world."""
        return msgspec.structs.replace(camera, T_world_camera=self.installation.in_world(camera.T_world_camera))

    def written(self, camera: CameraCalibration) -> CameraCalibration:
        """A calibration for a file, its pose in the installation's frame."""
        if self.installation.T_world_installation is None:
            return camera
        T = geometry.compose(self.installation.table.pose, camera.T_world_camera)
        return msgspec.structs.replace(camera, T_world_camera=T)
