"""Checks before a run starts, so that a problem that would end it later is an error before anything moves."""

from collections.abc import Mapping
from pathlib import Path

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.zenoh.session import check_shared_memory
from dlokit.errors import ConfigError
from dlokit.functional.cameras.base import SerialConfig
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.functional.cameras.simulated import SimulatedD435Config
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.functional.robots.strategies import DRIVERS
from dlokit.skills.viewer.serving.address import check_port
from dlokit.system.config import RunConfig
from dlokit.system.operator_start import check_operator
from dlokit.system.other_hosts import other_hosts
from dlokit.system.table import VIEWER, component_table, components_of_run, processes_of_run
from dlokit.types.image import CameraCalibration


def check_before_start(config: RunConfig, *, operator_confirms: bool = False) -> None:
    """Raise `MachineError` or `ConfigError` for problems that would end the run later. Shapes are not checked here.

    The system observes the DLO's position, and the task judges the goal with the model. With `operator_confirms` the
    start of a real arm needs no terminal.
    """
    from dlokit.system.configuration.installation_checks import check_installation  # loads the kinematics

    require_one_world(config)
    if config.runtime == "live":
        check_shared_memory()
    check_operator(config, confirms=operator_confirms)
    if config.calibration:
        check_calibration(config)
    check_installation(config)
    if (hosts := other_hosts(config)) is not None and config.runtime == "live":
        hosts.check(processes_of_run(config))
    if not config.headless and _viewer_is_here(config):
        check_port(config.viewer.host, config.viewer.port)
    if config.has_cell:
        from dlokit.functional.cell.rendering import check_opengl

        check_opengl()
    for name in components_of_run(config):
        component_table()[name].check(config)


def check_calibration(config: RunConfig) -> None:
    """Raise `ConfigError` when the calibration of a run has no pose, or is known to be of another camera."""
    from dlokit.functional.cameras.calibration_file import check_has_pose, check_same_camera, read_calibration

    calibration = read_calibration(Path(config.calibration))
    check_has_pose(config.calibration, calibration)
    if config.camera.sees_cell:  # a device that its settings do not name by serial is compared by its first pictures
        check_same_camera(config.calibration, calibration, camera_of_cell(config))
        return
    if isinstance(config.camera, RecordedCameraConfig):
        check_same_camera(config.calibration, calibration, config.camera.build(MemoryTransport()).calibration)
        return
    wanted = config.camera.serial if isinstance(config.camera, SerialConfig) else ""
    if wanted and calibration.serial not in ("", wanted):
        raise ConfigError(
            f"calibration {config.calibration} is of the camera {calibration.serial!r}, and --camera "
            f"{config.camera.name} is set to {wanted!r}: give the file of this camera, or calibrate it with "
            "`dlokit calibrate handeye`"
        )


def camera_of_cell(config: RunConfig) -> CameraCalibration:
    """The true calibration of the simulated camera that a run uses, with its serial number and picture size."""
    if isinstance(config.camera, SimulatedD435Config):
        from dlokit.functional.cell.depth_rendering import depth_camera

        return depth_camera(config.installation)
    from dlokit.functional.cell.rendering import cell_camera

    return cell_camera(config.cell, config.installation)


def require_one_world(config: RunConfig) -> None:
    """Raise `ConfigError` when the arm moves in one world and the camera sees another."""
    camera, driver = config.camera, config.driver
    if config.twin:
        _check_twin(config)
    if not config.dry_run and camera.sees_cell and not driver.in_cell and not config.twin:
        raise ConfigError(
            f"--driver {driver.name} does not move the arm of the simulated cell, which --camera {camera.name} shows: "
            f"choose --driver {_names(DRIVERS.installed(), 'in_cell')}, another camera, --dry-run, which moves no "
            "arm, or --twin, in which the cell's arm mirrors that of the driver."
        )
    if not config.dry_run and driver.in_cell:
        require_camera_of_cell(config)
    if config.runtime == "lockstep" and driver.is_real:
        raise ConfigError(f"--driver {driver.name} moves in real time; lockstep does not: add --runtime live.")
    if config.runtime == "lockstep" and not (camera.sees_cell or isinstance(camera, RecordedCameraConfig)):
        raise ConfigError(
            f"--camera {camera.name} takes pictures in real time; lockstep runs on virtual time, with simulated "
            "cameras and recorded pictures: add --runtime live."
        )


def _check_twin(config: RunConfig) -> None:
    """Raise `ConfigError` when the cell cannot mirror the arm of a driver."""
    if config.driver.in_cell:
        others = (name for name, of in DRIVERS.installed().items() if not of.in_cell)
        raise ConfigError(
            f"--twin mirrors the arm of a driver in the simulated cell, and --driver {config.driver.name} moves the "
            f"cell's own arm: choose --driver {' or '.join(others)}, or omit --twin."
        )
    if not config.camera.sees_cell:
        raise ConfigError(
            f"--twin is seen by the simulated cell's camera, and --camera {config.camera.name} sees another world: "
            f"choose {_names(CAMERAS.installed(), 'sees_cell')}, or omit --twin; a run with a real camera gets its "
            "finger feedback from the arm alone."
        )
    if config.hosts is not None:
        raise ConfigError("--twin runs on one machine, by whose clock cell and arm are stamped: omit [hosts].")


def _names(installed: Mapping[str, type], quality: str) -> str:
    return " or ".join(name for name, of in installed.items() if getattr(of, quality))


def require_camera_of_cell(config: RunConfig) -> None:
    """Raise `ConfigError` for a camera that does not show the simulated cell."""
    if not config.camera.sees_cell:
        raise ConfigError(
            f"--camera {config.camera.name} does not see the simulated cell, in which the arm moves: choose "
            f"{_names(CAMERAS.installed(), 'sees_cell')}; `dlokit track --camera {config.camera.name}` follows what it "
            "sees, without an arm, and `dlokit shape --dry-run` plans for it."
        )


def _viewer_is_here(config: RunConfig) -> bool:
    if (hosts := other_hosts(config)) is None or config.runtime == "lockstep":
        return True
    return VIEWER.name in [row.name for row in hosts.here(processes_of_run(config))]
