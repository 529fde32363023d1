"""Checks and preparations before a run starts; imported late, so that `--help` is fast."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from dlokit.errors import ConfigError, SkillFailure
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.skills.viewer.address import check_port
from dlokit.system.config import RunConfig
from dlokit.system.hosts.placement import main_host
from dlokit.system.table import VIEWER, processes_of_run


def check_before_start(config: RunConfig) -> None:
    """Raise `MachineError` or `ConfigError` for problems that would end the run later. Shapes are not checked here.

    The system observes where the DLO lies, and the task judges the goal with the model.
    """
    from dlokit.functional.cell.rendering import cell_camera, check_opengl

    require_camera_of_cell(config)
    require_homes_above_table(config)
    if config.calibration:
        from dlokit.functional.cameras.calibration_file import check_has_pose, check_same_camera, read_calibration

        calibration = read_calibration(Path(config.calibration))
        check_has_pose(config.calibration, calibration)
        check_same_camera(config.calibration, calibration, cell_camera(config.cell, config.installation))
    if config.hosts is not None and config.runtime == "live":
        from dlokit.system.hosts.routers import check_hosts

        check_hosts(config.hosts, processes_of_run(simulated=True, watched=not config.headless, arms=config.arms))
    if not config.headless and _viewer_is_here(config):
        check_port(config.viewer.host, config.viewer.port)
    check_opengl()


def require_camera_of_cell(config: RunConfig) -> None:
    """Raise `ConfigError` for a camera that sees something else than the simulated cell."""
    if not config.camera.sees_cell:
        raise ConfigError(
            f"--camera {config.camera.name} does not see the simulated cell, in which the arm moves: choose "
            f"{' or '.join(name for name, of in CAMERAS.installed().items() if of.sees_cell)}; "
            f"`dlokit track --camera {config.camera.name}` follows what it sees, without an arm."
        )


def require_homes_above_table(config: RunConfig) -> None:
    """Raise `ConfigError` where an arm of the installation could not stand at home, or `MachineError` without it."""
    from dlokit.motion.collisions import check_collisions
    from dlokit.motion.inverse_kinematics import ArmKinematics

    for mount in config.mounts:
        home_rad, box = mount.model.home_q_rad, mount.workspace
        place = ArmKinematics(mount.model, mount.T_world_base).forward(home_rad).position_m
        if not np.all((place >= box.lower_m) & (place <= box.upper_m)):
            raise ConfigError(
                f"the home of the arm {mount.robot} has its tool at {np.round(place, 3).tolist()} m in the world, "
                f"outside its workspace from {box.lower_m} to {box.upper_m}: give it a home_deg inside in the installation "
                "file, or widen the workspace there."
            )
        try:
            check_collisions(mount.model, home_rad[None, :], mount.T_world_base)
        except SkillFailure as failure:
            raise ConfigError(
                f"the arm {mount.robot} cannot stand at home: {failure}. Correct its base, its home_deg or the table "
                "in the installation file."
            ) from failure


def _viewer_is_here(config: RunConfig) -> bool:
    if config.hosts is None or config.runtime == "lockstep":
        return True
    return VIEWER.name in config.hosts.runs[main_host(config.hosts)]


def prepare(console: Console, config: RunConfig) -> None:
    """Compile and load the observer and the planner of a run, and show the progress."""
    from dlokit.skills.observer.kernels import load_kernels
    from dlokit.skills.planning.strategies import load

    with compile_progress(console, "the observer (1 of 2)"):
        load_kernels((config.observer.strategy,))
    with compile_progress(console, "the planner (2 of 2)"):
        load(config.planning.strategy)


@contextmanager
def compile_progress(console: Console, what: str) -> Generator[None]:
    """Show that `what` is prepared and, if Numba compiles, how many functions are finished."""
    from numba.core import event

    begun = done = 0
    with console.status(f"preparing {what}") as status:

        class Told(event.Listener):
            def on_start(self, event: Any) -> None:
                nonlocal begun
                begun += 1
                if begun == 1:  # compiling a kernel also compiles the functions that it calls
                    console.print(f"compiling the kernels of {what}: once per machine, about 20 s", highlight=False)

            def on_end(self, event: Any) -> None:
                nonlocal done
                done += 1
                status.update(f"compiling the kernels of {what}: {done} functions finished")

        with event.install_listener("numba:compile", Told()):
            yield
    if done:
        console.print(f"compiled {done} functions of {what}", highlight=False)
