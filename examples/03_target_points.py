"""Fig. 5c: the observer orders the first cloud into nodes, without a prior, and returns target points."""

from pathlib import Path

import matplotlib.pyplot as plt
from example_lab import draw_nodes, draw_points, draw_table, looked, result_of, run_example

from dlokit.skills.observer import api as observer
from dlokit.system.lockstep import LockstepSystem


async def example(system: LockstepSystem, picture: Path) -> None:
    seen = await looked(system)
    targets = result_of(await system.transport.call(observer.INITIALISE, seen.stamp_ns))
    print(f"{len(targets.nodes_world)} target points, {targets.visible.sum()} visible, health {targets.health:.2f}")

    figure, axes = plt.subplots(figsize=(6, 5))
    draw_table(axes, "target points")
    draw_points(axes, seen.points_world, "cloud")
    draw_nodes(axes, targets.nodes_world, "o-", "target points")
    draw_nodes(axes, targets.nodes_world[:1], "s", "node 0")
    axes.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("03_target_points.png", example)
