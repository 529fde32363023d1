"""Render the simulated cell at any time of a recorded run, to get pictures that the run did not record.

The truth gives the DLO's shape and the recorded states give the arms' joint angles. Both are interpolated between
records, 0.1 s apart for the truth and 0.02 s for the arms. Nothing is simulated again, so the pictures match the run
for every version that recorded it. The run's own components never see them.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dlokit.communication import topics
from dlokit.errors import InputError
from dlokit.evaluation.evaluator import read_truth
from dlokit.functional.cameras.simulated import SimulatedD435Config
from dlokit.functional.cell.arm import ArmPosture
from dlokit.functional.cell.rendering import viewpoint_camera
from dlokit.functional.cell.world import Cell
from dlokit.recording.reader import read_recording
from dlokit.system.config import RunConfig
from dlokit.system.configuration.recorded import recorded_config
from dlokit.types.arrays import Float64Array, Int64Array, UInt8Array
from dlokit.types.image import CameraPictures
from dlokit.types.robot import RobotState

PARTS = ("seed", "dry_run", "twin", "cell", "camera", "driver")
"""Sections of the configuration that the cell is built from."""


@dataclass(frozen=True, kw_only=True)
class _Motion:
    """The recorded states of one arm."""

    stamps_ns: Int64Array  # (T,) rising
    q_rad: Float64Array  # (T, J)
    widths_m: Float64Array  # (T,)

    def at(self, stamp_ns: int) -> ArmPosture:
        """The arm's state, interpolated between the two records around a time; constant outside of the records."""
        columns = np.column_stack([self.q_rad, self.widths_m]).T
        *q_rad, width_m = (float(np.interp(stamp_ns, self.stamps_ns, column)) for column in columns)
        return ArmPosture(q_rad=np.array(q_rad), finger_width_m=width_m)


class RecordedScene:
    """The cell of a recorded run. `close` releases OpenGL. Use it from one thread."""

    def __init__(self, path: Path, *, view_size_px: tuple[int, int] | None = None) -> None:
        """`path` is a recording beside the truth of its run; `view_size_px` is the size of pictures for people, if any.

        Raises `InputError`, with the reason, if the camera of the run saw no cell, or the truth is missing.
        """
        config = recorded_config(path, PARTS)
        if not config.camera.sees_cell:
            raise InputError(f"its camera ({config.camera.name}) saw no simulated cell")
        self._truth = read_truth(path.parent)
        self._motions = _motions(path, config)
        self._require_one_run(path)
        self._depth = isinstance(config.camera, SimulatedD435Config)
        self.viewpoint = (
            None if view_size_px is None else viewpoint_camera(*view_size_px, config.installation, config.mounts[0])
        )
        # Video compression removes pixel noise, and the noise would double the time and the size of the file.
        self._cell = Cell(
            replace(config.cell, image_noise_sigma=0.0),
            seed=config.seed,
            arms=config.mounts,
            installation=config.installation,
            viewpoint=self.viewpoint,
        )

    def pictures(self, stamp_ns: int) -> CameraPictures:
        """The view of the run's camera at a time [ns], without pixel noise.

        A depth camera has the errors of its depths. Raises `MachineError` without OpenGL.
        """
        self._show(stamp_ns)
        return self._cell.capture_depth() if self._depth else self._cell.capture()

    def view(self, stamp_ns: int) -> UInt8Array:
        """The view of a person at the table at a time [ns], (height, width, 3). Raises as `pictures`."""
        self._show(stamp_ns)
        return self._cell.view()

    def close(self) -> None:
        """Release OpenGL, which starts with the first picture."""
        self._cell.close()

    def _show(self, stamp_ns: int) -> None:
        arms = {robot: motion.at(stamp_ns) for robot, motion in self._motions.items()}
        self._cell.show(self._truth.at(stamp_ns), arms)

    def _require_one_run(self, path: Path) -> None:
        for motion in self._motions.values():
            if motion.stamps_ns[0] > self._truth.stamps_ns[-1] or motion.stamps_ns[-1] < self._truth.stamps_ns[0]:
                raise InputError(f"the truth in {path.parent} is of another time than {path}")


def _motions(path: Path, config: RunConfig) -> dict[str, _Motion]:
    """The motion of each arm of the cell by its name. Raises `InputError` if an arm has no state.

    In a dry run the robot component's arm moves in software only, so the cell's own states are read if there
    are any.
    """
    rows = (topics.ARM_STATE, topics.ROBOT_STATE)
    found: dict[str, list[RobotState]] = {row.at(mount.instance).name: [] for row in rows for mount in config.mounts}
    for one in read_recording(path, found):
        assert isinstance(one.message, RobotState)
        found[one.topic].append(one.message)
    motions: dict[str, _Motion] = {}
    for mount in config.mounts:
        states = next((of for row in rows if (of := found[row.at(mount.instance).name])), [])
        motions[mount.robot] = _motion(mount.robot, states, path)
    return motions


def _motion(robot: str, states: list[RobotState], path: Path) -> _Motion:
    if not states:
        raise InputError(f"{path} has no states of the arm {robot}")
    # Restarted components may publish a state twice.
    stamps_ns, first = np.unique(np.array([state.stamp_ns for state in states], dtype=np.int64), return_index=True)
    return _Motion(
        stamps_ns=stamps_ns,
        q_rad=np.array([states[number].q_rad for number in first]),
        widths_m=np.array([states[number].finger_width_m for number in first]),
    )
