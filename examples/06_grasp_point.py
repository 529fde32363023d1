"""Fig. 5f: the grasp point is the valid node farthest from its goal; marked nodes are omitted."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_lab import draw_nodes, draw_table, run_example
from example_steps import goal_named, proposed, tracked_state

from dlokit.system.lockstep import LockstepSystem


async def example(system: LockstepSystem, picture: Path) -> None:
    goal = await goal_named(system, "I")
    state = await tracked_state(system, goal)
    best = await proposed(system, state, goal, np.array([], dtype=np.int64))
    next_best = await proposed(system, state, goal, np.array([best.grasp.node]))
    print(f"best node {best.grasp.node}; with it marked, node {next_best.grasp.node}")

    figure, axes = plt.subplots(figsize=(6, 5))
    draw_table(axes, "grasp point")
    draw_nodes(axes, state.nodes_world, "o-", "shape")
    draw_nodes(axes, goal.nodes_world, "--", "goal")
    for action, color in ((best, "red"), (next_best, "orange")):
        at, to = action.grasp.T_world_tcp.position_m, action.path[-1].position_m
        axes.annotate(
            f"node {action.grasp.node}",
            xytext=(float(at[1]), float(at[0])),
            xy=(float(to[1]), float(to[0])),
            color=color,
            arrowprops={"arrowstyle": "->", "color": color},
        )
    axes.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("06_grasp_point.png", example)
