"""Fig. 5e: three frames pull a simulated rod, so that the goal respects the mechanics of the DLO."""

import math
from pathlib import Path

import matplotlib.pyplot as plt
from example_lab import draw_nodes, draw_table, result_of, run_example

from dlokit.skills.model import api as model
from dlokit.system.lockstep import LockstepSystem
from dlokit.types.flow import GoalFrame

FRAMES = (
    GoalFrame(node=0, x_m=0.45, y_m=-0.2),
    GoalFrame(node=15, x_m=0.60, y_m=0.0, yaw_rad=math.pi / 2),
    GoalFrame(node=30, x_m=0.45, y_m=0.2),
)


async def example(system: LockstepSystem, picture: Path) -> None:
    goal = result_of(await system.transport.call(model.BUILD_GOAL, FRAMES))

    figure, axes = plt.subplots(figsize=(6, 5))
    draw_table(axes, "goal from three frames")
    draw_nodes(axes, goal.nodes_world, "o-", "goal")
    for frame in FRAMES:
        off_m = math.hypot(*(goal.nodes_world[frame.node, :2] - (frame.x_m, frame.y_m)))
        print(f"node {frame.node}: {off_m * 1e3:.1f} mm from its frame")
        axes.plot(frame.y_m, frame.x_m, "r+", markersize=14)
    axes.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("05_goal_from_three_frames.png", example)
