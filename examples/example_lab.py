"""Common parts of the numbered examples: a simulated cell in lockstep and a folder for the picture."""

import tempfile
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import matplotlib as mpl

from dlokit.app.environment import prepare_environment

prepare_environment()
mpl.use("Agg")

import tyro  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402

from dlokit.communication import topics  # noqa: E402
from dlokit.communication.timing import virtual_time  # noqa: E402
from dlokit.skills.perception import api as perception  # noqa: E402
from dlokit.skills.planning.config import PlanningConfig  # noqa: E402
from dlokit.skills.planning.farthest import FarthestConfig  # noqa: E402
from dlokit.system.config import RunConfig  # noqa: E402
from dlokit.system.job import job_from_config  # noqa: E402
from dlokit.system.lockstep import LockstepSystem, lockstep_system  # noqa: E402
from dlokit.types.arrays import Float32Array, Float64Array  # noqa: E402
from dlokit.types.observation import Observation  # noqa: E402
from dlokit.types.outcome import Outcome, Succeeded  # noqa: E402

R = TypeVar("R")


@dataclass(frozen=True)
class ExampleArgs:
    """One skill of the paper's section 5.1, alone, on the simulated cell."""

    out: Path = Path("runs/examples")
    """Folder for the picture."""
    start: str = "S"
    """Start shape of the rope."""
    seed: int = 0
    """Seed of the camera's noise and error."""


async def looked(system: LockstepSystem) -> Observation:
    """Look once and return the published cloud."""
    result_of(await system.transport.call(perception.LOOK))
    seen = system.transport.latest(topics.OBSERVATION).value
    assert seen is not None, "a look that succeeded has published its cloud"
    return seen


def run_example(picture: str, example: Callable[[LockstepSystem, Path], Awaitable[None]], start: str = "S") -> None:
    """Start the cell and all components on virtual time, run the example, and print the path of its picture."""
    args = tyro.cli(ExampleArgs, default=ExampleArgs(start=start))
    args.out.mkdir(parents=True, exist_ok=True)
    config = RunConfig(
        start=args.start, seed=args.seed, headless=True, planning=PlanningConfig(strategy=FarthestConfig())
    )

    async def main() -> None:
        with tempfile.TemporaryDirectory() as folder:
            job = job_from_config(config)
            async with lockstep_system(config, job.start_nodes_world, Path(folder)) as system:
                await system.clock.sleep(0.1)  # until the robot has published its state
                await example(system, args.out / picture)

    virtual_time.run(main())
    print(f"picture: {args.out / picture}")


def result_of(outcome: Outcome[R]) -> R:
    """Return the result of a skill call, or end the example with the outcome."""
    if not isinstance(outcome, Succeeded):
        raise SystemExit(f"the skill did not succeed: {outcome}")
    return outcome.result


def draw_table(axes: Axes, title: str) -> None:
    """Draw the table from above, in metres, as seen from behind the robot."""
    axes.set_title(title)
    axes.set_xlabel("y [m]")
    axes.set_ylabel("x [m]")
    axes.set_aspect("equal")
    axes.set_xlim(0.4, -0.4)
    axes.set_ylim(0.25, 0.8)
    axes.grid(alpha=0.3)


def draw_nodes(axes: Axes, nodes_world: Float64Array, style: str, label: str) -> None:
    """Draw a rod (M, 3) [m] from above."""
    axes.plot(nodes_world[:, 1], nodes_world[:, 0], style, label=label)


def draw_points(axes: Axes, points_world: Float32Array, label: str) -> None:
    """Draw a cloud (N, 3) [m] from above."""
    axes.scatter(points_world[:, 1], points_world[:, 0], s=2, c="0.6", label=label)
