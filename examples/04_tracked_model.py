"""Fig. 5d: a PD controller drags the model to the target points; its shape is the state."""

import asyncio
from pathlib import Path

import matplotlib.pyplot as plt
from example_lab import draw_nodes, draw_points, draw_table, looked, result_of, run_example

from dlokit.communication import topics
from dlokit.skills.observer import api as observer
from dlokit.system.lockstep import LockstepSystem


async def example(system: LockstepSystem, picture: Path) -> None:
    states = system.transport.stream(topics.STATE)
    seen = await looked(system)
    targets = result_of(await system.transport.call(observer.INITIALISE, seen.stamp_ns))
    async with asyncio.timeout(5.0):
        state = await anext(states)
    print(f"model follows the target points to {state.tracking_error_m * 1e3:.2f} mm (RMS over nodes)")

    figure, axes = plt.subplots(figsize=(6, 5))
    draw_table(axes, "tracked model")
    draw_points(axes, seen.points_world, "cloud")
    draw_nodes(axes, targets.nodes_world, "x", "target points")
    draw_nodes(axes, state.nodes_world, "o-", "model")
    axes.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("04_tracked_model.png", example)
