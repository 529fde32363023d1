"""How closely the driver of the Franka tracks against franky-sim, and how soon the arm stands when a process fails.

python benchmarks/franka_tracking.py, after make test-peers has installed the simulator.

Angles and heights are those of the simulator's own log. The machine's load is printed with every figure: the simulator
runs in real time on the same cores.
"""

import asyncio
import os
import sys
import tempfile
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

from franky_server import FrankyServer, why_not

from dlokit.description.arm.franka import FR3
from dlokit.errors import ConfigError, MachineError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import median
from dlokit.extras.franka.channel import Channel, path_of
from dlokit.extras.franka.driver import FrankaRobot
from dlokit.geometry import downward
from dlokit.motion.forward_kinematics import tcp_matrices
from dlokit.motion.inverse_kinematics import ArmKinematics
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move, tool_move
from dlokit.types.action import VelocityProfile
from dlokit.types.robot import JointTrajectory, Lease
from parts.command import check_json, run_study, write_figures
from parts.franka_commander import AWAY_RAD, franka
from parts.franka_stops import FAULTS, stopped_after

_PACES = (0.1, 0.3, 0.6, 1.0)
_STOP_PACE = 0.6
_LEASE = Lease(holder="bench", duration_s=0.2)
_LOW_M = FR3.gripper.grasp_height_m()
"""Height of the tool centre point at which the fingertips are 2 mm above the table [m]."""
_KINEMATICS = ArmKinematics(FR3)


@dataclass(frozen=True, kw_only=True)
class Args:
    """Move the simulated FR3 through the driver, and let each process fail in mid-motion."""

    repeats: int = 5
    """Times that every motion and every fault is repeated."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if args.repeats < 1:
        raise ConfigError(f"--repeats {args.repeats} must be at least 1.")
    check_json(args.json)
    if reason := why_not():
        raise MachineError(f"This study needs franky-sim: {reason}.")
    console = Console(highlight=False, soft_wrap=True)
    rows: list[BenchFigure] = []
    with tempfile.TemporaryDirectory() as folder:
        rows += asyncio.run(_tracking(Path(folder), args.repeats, console))
        rows += _stops(Path(folder), args.repeats, console)
    write_figures(args.json, "franka_tracking", rows, {"repeats": args.repeats}, console)
    return 0


async def _tracking(folder: Path, repeats: int, console: Console) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    with FrankyServer(folder) as server, Channel(path_of(server.address, folder)) as channel:
        async with franka(server.address, folder) as robot:
            for pace in _PACES:
                found: defaultdict[str, list[float]] = defaultdict(list)
                for _ in range(repeats):
                    for target in (AWAY_RAD, FR3.home_q_rad):
                        move = scaled(joint_move(robot.state().q_rad, target, FR3.limits), pace)
                        result = await robot.follow(move, _LEASE)
                        state = channel.read_state()
                        assert state is not None
                        found["largest error"].append(result.largest_joint_error_rad)
                        found["mean error"].append(state.mean_error_rad)
                        found["error at the end"].append(float(np.abs(result.q_rad - move.q_rad[-1]).max()))
                rows += _printed(f"joint motion at {pace:g} of the limits", found, "rad", 1e3, "mrad", console)
            rows += await _low(robot, server, repeats, console)
    return rows


async def _low(robot: FrankaRobot, server: FrankyServer, repeats: int, console: Console) -> list[BenchFigure]:
    """The tool's height with the fingertips 2 mm above the table, as a grasp and a drag go."""
    above = _KINEMATICS.inverse(downward([0.45, 0.1, 0.1], np.pi / 2))
    found: defaultdict[str, list[float]] = defaultdict(list)
    for _ in range(repeats):
        await robot.follow(scaled(joint_move(robot.state().q_rad, above, FR3.limits), 0.3), _LEASE)
        await robot.follow(_straight(robot, [0.45, 0.1, _LOW_M]), _LEASE)
        found["at the grasp"].append(_heights(server, 0.1)[-1] - _LOW_M)
        drag = _straight(robot, [0.5, -0.1, _LOW_M])
        start_m = tcp_matrices(FR3, drag.q_rad[0])[0][2, 3]  # where it was measured: planned down from there
        began_ns = server.now().now_ns
        await robot.follow(drag, _LEASE)
        planned = np.linspace(start_m, _LOW_M, 101)
        heights = tcp_matrices(FR3, np.array([each.q for each in server.since(began_ns)[::10]]))[:, 2, 3]
        found["largest in the drag"].append(float(np.max(np.abs(heights - np.mean(planned)))))
        found["lowest in the drag"].append(float(np.min(heights)) - _LOW_M)
        await robot.follow(_straight(robot, [0.5, -0.1, 0.1]), _LEASE)
    return _printed("tool height, fingertips 2 mm above the table", found, "m", 1e3, "mm", console)


def _straight(robot: FrankaRobot, place_m: list[float]) -> JointTrajectory:
    return tool_move(_KINEMATICS, robot.state().q_rad, (downward(place_m, np.pi / 2),), VelocityProfile())


def _heights(server: FrankyServer, seconds: float) -> list[float]:
    since_ns = server.now().now_ns - round(seconds * 1e9)
    return [float(tcp_matrices(FR3, each.q)[0][2, 3]) for each in server.since(since_ns)[::20]]


def _stops(folder: Path, repeats: int, console: Console) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    for fault in FAULTS:
        found: defaultdict[str, list[float]] = defaultdict(list)
        for _ in range(repeats):
            with FrankyServer(folder) as server:
                stopped = stopped_after(fault, server, folder, _STOP_PACE)
            found["until it brakes"].append(stopped.braking_s)
            found["until it stands"].append(stopped.standing_s)
            found["until it stands, simulated"].append(stopped.simulated_s)
        rows += _printed(fault, found, "s", 1.0, "s", console)
    return rows


def _printed(
    case: str, found: dict[str, list[float]], unit: str, factor: float, shown: str, console: Console
) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    load = os.getloadavg()[0]
    for metric, values in found.items():
        middle = median(values)
        spread = f"{factor * min(values):.3g} to {factor * max(values):.3g}"
        console.print(
            f"{case}, {metric}: {factor * middle.value:.3g} {shown} (median of {middle.n}, {spread}; load {load:.1f})"
        )
        rows.append(figure(case, "franka", metric, middle, unit))
    return rows


if __name__ == "__main__":
    run_study(Args, run, __doc__)
