"""Do runs whose camera is in ROS 2 end as those without ROS do, and in how many actions?

python benchmarks/ros2_runs.py --distribution jazzy --seeds 500 501
The pictures of the cell's simulated D435 reach dlokit over real ROS 2 alone, the arm is the cell's. `make test-ros`
installs ROS 2. Each case also runs without ROS, with `--camera simulated-d435`.
"""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import msgspec
from rich.console import Console

from dlokit.errors import MachineError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval, success_rate
from parts.command import check_json, run_study, write_figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

PAIRS = (("I", "S"), ("S", "I"), ("random", "S"))
ROS, WITHOUT = "over ROS", "without ROS"


@dataclass(frozen=True, kw_only=True)
class Args:
    """Shape the rope from I to S, S to I and random to S, with the camera over ROS 2 and without."""

    distribution: Literal["jazzy", "kilted"] = "jazzy"
    """Distribution of ROS 2."""
    seeds: tuple[int, ...] = (500, 501, 502, 503, 504)
    """Seeds of the runs."""
    out: Path | None = None
    """Folder of the runs; default: a temporary one, which is removed."""
    json: Path | None = None
    """Write the figures to this file."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a run ended."""

    outcome: str
    actions: int
    true_rmse_m: float | None


def run(args: Args) -> int:
    """Run all cases; exit code 0."""
    from ros_lab import RosEnvironment

    check_json(args.json)
    environment = RosEnvironment(args.distribution)
    if why_not := environment.why_not("tf2_msgs"):
        raise MachineError(why_not)
    console = Console(highlight=False, soft_wrap=True)
    ended: dict[tuple[str, int, str], Ended] = {}
    with tempfile.TemporaryDirectory(prefix="dlk") as scratch:
        out = (args.out or Path(scratch)).resolve()
        out.mkdir(parents=True, exist_ok=True)
        for start, goal in PAIRS:
            for seed in args.seeds:
                for method in (WITHOUT, ROS):
                    folder = out / f"{start}-{goal}-{seed}-{'ros' if method == ROS else 'plain'}"
                    arguments = ("--start", start, "--goal", goal, "--seed", str(seed), "--out", str(folder))
                    one = _over_ros(environment, folder, arguments) if method == ROS else _shaped(folder, arguments)
                    ended[f"{start} to {goal}", seed, method] = one
                    true = "" if one.true_rmse_m is None else f", true RMSE {one.true_rmse_m * 1e3:.1f} mm"
                    console.print(
                        f"{start} to {goal}, seed {seed}, {method}: {one.outcome}, {one.actions} actions{true}"
                    )
    write_figures(args.json, "ros2_runs", list(_figures(ended, console)), {"distribution": args.distribution}, console)
    return 0


def _figures(ended: dict[tuple[str, int, str], Ended], console: Console) -> list[BenchFigure]:
    rows: list[BenchFigure] = []
    for method in (WITHOUT, ROS):
        of = [one for (_, _, how), one in ended.items() if how == method]
        converged = sum(one.outcome == "converged" for one in of)
        actions = sum(one.actions for one in of)
        console.print(f"{method}: {converged} of {len(of)} converged, {actions} actions")
        rows.append(figure("all pairs", method, "converged", success_rate(converged, len(of)), "1"))
        total = Interval(value=float(actions), low=None, high=None, n=len(of))
        rows.append(figure("all pairs", method, "actions", total, "1"))
    return rows


def _over_ros(environment: Any, folder: Path, arguments: tuple[str, ...]) -> Ended:
    """A run whose pictures pass through a lab of its own."""
    from installed_packages import install
    from ros_feeder import LabCamera, feeding
    from ros_lab import ros_network

    lab = folder.with_name(f"{folder.name}-lab")
    runtime = Path(tempfile.mkdtemp(prefix="dlk"))
    packages = lab / "packages"
    install(packages, "cell-over-ros", "dlokit.cameras", {"ros2-cell": "cell_over_ros:Camera"}, {"cell_over_ros": CELL})
    before = os.environ.get("DLOKIT_RUNTIME_DIR")
    os.environ["DLOKIT_RUNTIME_DIR"] = str(runtime)  # the feeder looks for the run there
    camera = LabCamera()
    topics = ("--camera", "ros2-cell", "--camera.colour", camera.colour, "--camera.depth", camera.depth)
    try:
        with ros_network(environment, lab) as network:
            network.bridge(runtime)
            with feeding(network.camera(), camera, rate_hz=10.0):
                return _shaped(folder, (*arguments, *topics), packages)
    finally:
        if before is None:
            del os.environ["DLOKIT_RUNTIME_DIR"]
        else:
            os.environ["DLOKIT_RUNTIME_DIR"] = before


CELL = '''
from dataclasses import dataclass
from typing import ClassVar

from dlokit.extras.ros2.camera import Ros2CameraConfig


@dataclass(frozen=True, kw_only=True)
class Camera(Ros2CameraConfig):
    """The camera of the simulated cell, published in ROS 2."""

    name: ClassVar[str] = "ros2-cell"
    sees_cell: ClassVar[bool] = True
'''
"""A camera in ROS 2 that sees the cell, so that the arm of the cell may be used."""


def _shaped(folder: Path, arguments: tuple[str, ...], packages: Path | None = None) -> Ended:
    command = [sys.executable, "-c", "from dlokit.app.main import main; main()", "shape", "--runtime", "live"]
    camera = () if packages else ("--camera", "simulated-d435")
    path = os.pathsep.join(filter(None, (str(packages or ""), os.environ.get("PYTHONPATH", ""))))
    log = folder.with_name(f"{folder.name}.log")
    with log.open("wb") as output:
        subprocess.run(
            [*command, "--headless", *camera, *arguments],
            env={**os.environ, "PYTHONPATH": path},
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
    result = folder / "result.json"
    if not result.exists():
        return Ended(outcome=f"no result ({log})", actions=0, true_rmse_m=None)
    found = msgspec.json.decode(result.read_bytes())
    true = found.get("true_rmse_m")
    return Ended(outcome=found["outcome"], actions=found["actions"], true_rmse_m=true)


if __name__ == "__main__":
    run_study(Args, run, __doc__)
