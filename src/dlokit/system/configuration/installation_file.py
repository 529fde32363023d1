"""The files of `--installation` and `--fixtures`: table, arms, fixtures and camera in a lab.

[table]                          # each part and each key may be left out
position_m = [0.0, 0.0, 0.08]    # the world's origin, in a frame of your choice
rpy_deg = [1.0, 0.0, 0.0]

[[arms]]
model = "panda"                  # or the file of an arm, beside this file
position_m = [0.0, 0.0, 0.0]
rpy_deg = [0.0, 0.0, 90.0]

[[fixtures]]                     # on the table; also in a file of their own, for `--fixtures`
kind = "post"
name = "A"
position_m = [0.45, 0.10, 0.0]   # the middle of its foot, in the world

[camera]
calibration = "calibration.toml"
[camera.driver]
kind = "realsense"
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import scipy

from dlokit import geometry
from dlokit.description.installation import Installation, InstalledArm, InstalledTable, Place
from dlokit.description.scene import Fixture
from dlokit.errors import ConfigError
from dlokit.functional.cameras.simulated import SimulatedStereoConfig
from dlokit.functional.cameras.strategies import AnyCamera
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import read_toml

_SAME_POINT_M = 1e-3
"""A camera cannot look at a point nearer than this [m]."""
_DIGITS = 6
"""Decimal places of an angle that follows from a point [°]: far below what a ruler measures."""


@dataclass(frozen=True, kw_only=True)
class InstalledCamera:
    """The camera: its driver and its pose."""

    driver: AnyCamera = field(default_factory=SimulatedStereoConfig)
    """The camera's driver and its settings, such as a serial number."""
    calibration: str = ""
    """File that `dlokit calibrate` wrote, beside this one; a camera of another serial number is refused."""
    position_m: tuple[float, float, float] | None = None
    """Its position in the installation's frame [m], measured by ruler, when no calibration provides its pose."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw of the camera's frame: x right, y down, z forward in its picture [°]."""
    look_at_m: tuple[float, float, float] | None = None
    """Instead of `rpy_deg`: the point in the installation's frame that is in the middle of its picture [m]. The rows of
    the picture are horizontal; of a camera that looks straight down they point along the x axis."""

    def __post_init__(self) -> None:
        if self.calibration and self.position_m is not None:
            raise ConfigError("has calibration and position_m, which both give its position: leave one out")
        if self.look_at_m is None:
            return
        if self.position_m is None or any(self.rpy_deg):
            raise ConfigError("has look_at_m, which goes with position_m and replaces rpy_deg and calibration")
        if math.dist(self.position_m, self.look_at_m) < _SAME_POINT_M:
            raise ConfigError("has the same point as position_m and look_at_m: give a point in front of the camera")

    @property
    def place(self) -> Place | None:
        """Its pose as measured by ruler."""
        if self.position_m is None:
            return None
        if self.look_at_m is None:
            return Place(position_m=self.position_m, rpy_deg=self.rpy_deg)
        forward = np.subtract(self.look_at_m, self.position_m)
        turned = scipy.spatial.transform.Rotation.from_matrix(geometry.looking_along(forward))
        roll, pitch, yaw = np.round(turned.as_euler("xyz", degrees=True), _DIGITS).tolist()
        return Place(position_m=self.position_m, rpy_deg=(roll, pitch, yaw))


@dataclass(frozen=True, kw_only=True)
class InstallationFile:
    """The settings that the file may contain."""

    table: InstalledTable = field(default_factory=InstalledTable)
    arms: tuple[InstalledArm, ...] = Installation().arms
    fixtures: tuple[Fixture, ...] = ()
    camera: InstalledCamera = field(default_factory=InstalledCamera)


@dataclass(frozen=True, kw_only=True)
class FixturesFile:
    """The settings that a file of fixtures may contain."""

    fixtures: tuple[Fixture, ...] = ()


def with_fixtures(run: RunConfig, path: Path) -> RunConfig:
    """A configuration with the fixtures of a file in place of its own. Raises `ConfigError`, which names the file."""
    said = read_toml(path, FixturesFile, "docs/how-to/describe-fixtures.md says what is in it")
    try:
        return replace(run, installation=replace(run.installation, fixtures=said.fixtures))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def with_installation(run: RunConfig, path: Path) -> RunConfig:
    """A configuration with the settings of an installation file. Raises `ConfigError`, which names file and key."""
    said = read_toml(path, InstallationFile, "docs/how-to/describe-an-installation.md says what is in it")
    folder = path.expanduser().absolute().parent
    arms = tuple(replace(arm, model=_beside(folder, arm.model)) for arm in said.arms)
    try:
        installation = Installation(table=said.table, arms=arms, fixtures=said.fixtures, camera=said.camera.place)
        camera = said.camera.driver
        return replace(
            run, installation=installation, camera=camera, calibration=_beside(folder, said.camera.calibration)
        )
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _beside(folder: Path, name: str) -> str:
    """A relative file name, resolved against a folder; an absolute name is unchanged."""
    return str(folder / Path(name).expanduser()) if name.endswith(".toml") else name
