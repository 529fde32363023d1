"""How far the pose of a moving arm, as perception uses it for a picture, is from where the arm was at the exposure.

python benchmarks/robot_at_exposure.py
"""

import asyncio
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from scipy.interpolate import CubicSpline

from dlokit import geometry
from dlokit.communication import topics
from dlokit.communication.timing import virtual_time
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import median
from dlokit.skills.perception import api as perception
from dlokit.skills.perception.robot_history import RobotHistory
from dlokit.skills.robot import api as robot
from dlokit.system.config import RunConfig
from dlokit.system.lockstep import lockstep_system
from dlokit.types.action import VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.outcome import Succeeded
from dlokit.types.robot import RobotState
from parts.command import check_json, run_study, write_figures

LOOKS_HZ = 20.0
FROM_M, TO_M = (0.45, -0.25, 0.25), (0.45, 0.25, 0.25)
FASTEST_M_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Args:
    """Move the simulated tool along a line while perception takes pictures, and compare its poses at their stamps.

    The reference is a spline through all states of the arm, before and after each picture.
    """

    speed_m_s: float = 0.3
    """Speed of the tool [m/s]."""
    json: Path | None = None
    """Write the figures to this file."""


@dataclass(frozen=True, kw_only=True)
class Seen:
    """One picture, and what was known of the arm when it came."""

    stamp_ns: int
    newest: RobotState


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if not 0.01 <= args.speed_m_s <= FASTEST_M_S:
        raise ConfigError(f"--speed-m-s {args.speed_m_s} must be from 0.01 to {FASTEST_M_S}.")
    check_json(args.json)
    states, pictures = virtual_time.run(moving(args.speed_m_s))
    stamps_s = np.array([state.stamp_ns for state in states]) / 1e9
    true = CubicSpline(stamps_s, np.array([state.T_world_tcp.position_m for state in states]))
    off_m: dict[str, list[float]] = {"newest state": [], "first state after it": [], "interpolated": []}
    for seen in pictures:
        history = RobotHistory()
        later = [state for state in states if state.stamp_ns >= seen.stamp_ns]
        if not later:
            continue
        for state in (*(state for state in states if state.stamp_ns < seen.stamp_ns), later[0]):
            history.add(state)
        used = {
            "newest state": seen.newest,
            "first state after it": later[0],
            "interpolated": history.at(later[0].robot, seen.stamp_ns) or later[0],
        }
        for name, state in used.items():
            off_m[name].append(_distance_m(state, np.asarray(true(seen.stamp_ns / 1e9))))
    console = Console(highlight=False, soft_wrap=True)
    rows = []
    for name, values in off_m.items():
        middle = median(values)
        console.print(
            f"{name:22} {middle.value * 1e3:6.2f} mm (median of {middle.n}), at most {max(values) * 1e3:.2f} mm"
        )
        rows.append(figure("tool on a line", name, "error of the tool's position", middle, "m"))
    write_figures(args.json, "robot_at_exposure", rows, {"speed_m_s": args.speed_m_s}, console)
    return 0


def _distance_m(state: RobotState, position_m: Float64Array) -> float:
    return float(np.linalg.norm(state.T_world_tcp.position_m - position_m))


async def moving(speed_m_s: float) -> tuple[list[RobotState], list[Seen]]:
    """All states of the arm, and the pictures during its motion. Raises `MachineError` where it does not move."""
    config = RunConfig(record=False)
    start = builtin_shape("I", config.cell.dlo.length_m, 100)
    states: list[RobotState] = []
    pictures: list[Seen] = []
    with tempfile.TemporaryDirectory() as folder:
        async with lockstep_system(config, start, Path(folder)) as system:

            async def hear() -> None:
                async for state in system.transport.stream(topics.ROBOT_STATE):
                    states.append(state)  # noqa: PERF401  # each as it comes, not all at the end

            async def watch() -> None:
                async for images in system.transport.stream(topics.STEREO_IMAGES):
                    pictures.append(Seen(stamp_ns=images.stamp_ns, newest=states[-1]))  # noqa: PERF401

            helpers = [asyncio.create_task(hear()), asyncio.create_task(watch())]
            await system.clock.sleep(0.5)
            await system.transport.call(perception.SET_TRACKING, LOOKS_HZ)
            ready = await system.transport.call(robot.MOVE_TO, geometry.downward(FROM_M, 0.0))
            begun = len(pictures)
            profile = VelocityProfile(speed_m_s=speed_m_s)
            moved = await system.transport.call(robot.MOVE_LINEAR, geometry.downward(TO_M, 0.0), profile)
            ended = len(pictures)
            await system.clock.sleep(0.1)
            for helper in helpers:
                helper.cancel()
    for outcome in (ready, moved):
        if not isinstance(outcome, Succeeded):
            raise MachineError(f"the arm did not move: {outcome}")
    return states, pictures[begun:ended]


if __name__ == "__main__":
    run_study(Args, run, __doc__)
