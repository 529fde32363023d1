"""One shaping task with the driver of the Franka against franky-sim, and how well the cell mirrored its arm."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from franky_server import FrankyServer

from dlokit.communication.topics import ARM_STATE, ROBOT_STATE
from dlokit.evaluation.judged_run import judged_run
from dlokit.extras.franka.driver import FrankaRobotConfig
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.reader import Recorded, read_recording
from dlokit.system.config import RunConfig
from dlokit.system.configuration.preflight import check_before_start
from dlokit.system.job import job_from_config
from dlokit.system.operator_start import RealStart
from dlokit.system.results.run_result import RunResult
from dlokit.system.shaping import Watcher
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import RobotState

ADDRESS = "127.0.31.3"
_MOVES_RAD_S = 0.02
"""An arm of which a joint is faster than this is in motion [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Mirrored:
    """How well the cell's arm followed the driver's, by the recording of a run; rates and medians of motions alone."""

    twin_hz: float
    """States of the cell's arm per second on the bus; each has mirrored the driver's newest."""
    longest_gap_s: float
    """Longest time between two of them in a motion [s]."""
    driver_hz: float
    """States of the driver per second on the bus."""
    median_rad: float
    """Median over the states of the largest difference of a joint between driver and cell at the same time [rad]."""
    largest_rad: float
    """The largest of all, also at rest [rad]."""


class _Confirming(Watcher):
    """Confirms the start: the arm is a simulated one."""

    async def confirm(self, start: RealStart) -> None:
        pass


def twin_config(start: str, goal: str, seed: int) -> RunConfig:
    """A usual live run, but for the driver and the cell that mirrors its arm."""
    driver = FrankaRobotConfig(address=ADDRESS, real_time=False)
    return RunConfig(
        start=start, goal=goal, seed=seed, runtime="live", headless=True, arm="fr3", twin=True, driver=driver
    )


def twin_run(config: RunConfig, folder: Path) -> RunResult:
    """Run one task in `folder`, which exists and is empty."""
    check_before_start(config, operator_confirms=True)
    with FrankyServer(folder, ADDRESS):
        return judged_run(config, job_from_config(config), folder, _Confirming()).result


def mirrored(folder: Path) -> Mirrored:
    """Read how well the cell's arm followed from the recording of a run."""
    own, cell = (_States(folder, topic.name) for topic in (ROBOT_STATE, ARM_STATE))
    inside = (cell.stamps_s >= own.stamps_s[0]) & (cell.stamps_s <= own.stamps_s[-1])
    cell_s = cell.stamps_s[inside]
    driver_rad = np.column_stack([np.interp(cell_s, own.stamps_s, joint) for joint in own.q_rad.T])
    off_rad = np.abs(cell.q_rad[inside] - driver_rad).max(axis=1)
    moves = own.moves_at(cell_s)
    gaps_s = cell.gaps_s(own)
    return Mirrored(
        twin_hz=1.0 / float(np.mean(gaps_s)),
        longest_gap_s=float(np.max(gaps_s)),
        driver_hz=1.0 / float(np.mean(own.gaps_s(own))),
        median_rad=float(np.median(off_rad[moves])),
        largest_rad=float(np.max(off_rad)),
    )


class _States:
    """The recorded states of one arm; those of an arm at rest are thinned."""

    def __init__(self, folder: Path, topic: str) -> None:
        rows: list[tuple[Recorded, RobotState]] = []
        for row in read_recording(folder / FILE_NAME, {topic}):
            assert isinstance(row.message, RobotState)
            rows.append((row, row.message))
        self.stamps_s: Float64Array = np.array([state.stamp_ns for _, state in rows]) / 1e9
        self.q_rad: Float64Array = np.array([state.q_rad for _, state in rows])
        self._logs_s: Float64Array = np.array([row.log_ns for row, _ in rows]) / 1e9
        self._speed_rad_s: Float64Array = np.array([np.abs(state.dq_rad_s).max() for _, state in rows])

    def moves_at(self, stamps_s: Float64Array) -> "np.ndarray[tuple[int], np.dtype[np.bool_]]":
        """Whether the arm is in motion at times (K,) [s]."""
        return np.interp(stamps_s, self.stamps_s, self._speed_rad_s) > _MOVES_RAD_S

    def gaps_s(self, driver: "_States") -> Float64Array:
        """Times between two arrivals on the bus during motions of the driver's arm (K,) [s]."""
        moves = driver.moves_at(self.stamps_s)
        return np.diff(self._logs_s)[moves[1:] & moves[:-1]]
