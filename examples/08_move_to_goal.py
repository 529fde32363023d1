"""Fig. 5h: one whole action: grasp, carry along the planned path, release, and look again."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_lab import draw_nodes, draw_table, result_of, run_example
from example_steps import goal_named, proposed, tracked_state

from dlokit.geometry import matrix, pose_from_matrix, rmse_m
from dlokit.skills.robot import api as robot
from dlokit.system.lockstep import LockstepSystem

ABOVE_M = 0.06


async def example(system: LockstepSystem, picture: Path) -> None:
    call = system.transport.call
    goal = await goal_named(system, "S")
    before = await tracked_state(system, goal)
    action = await proposed(system, before, goal, np.array([], dtype=np.int64))
    above = matrix(action.grasp.T_world_tcp)
    above[2, 3] += ABOVE_M

    result_of(await call(robot.RELEASE, action.grasp.opening_m))
    result_of(await call(robot.MOVE_TO, pose_from_matrix(above)))
    result_of(await call(robot.MOVE_LINEAR, action.grasp.T_world_tcp, action.velocity))
    grip = result_of(await call(robot.GRASP, 20.0))
    carried = result_of(await call(robot.FOLLOW_PATH, action.path, action.velocity))
    result_of(await call(robot.RELEASE, action.grasp.opening_m))
    up = matrix(action.path[-1])
    up[2, 3] += ABOVE_M
    result_of(await call(robot.MOVE_LINEAR, pose_from_matrix(up), action.velocity))
    result_of(await call(robot.HOME))
    after = await tracked_state(system, goal)
    errors = [rmse_m(state.nodes_world, goal.nodes_world) * 1e3 for state in (before, after)]
    print(f"held: {grip.held}; carried in {carried.duration_s:.2f} s; RMSE {errors[0]:.1f} mm, then {errors[1]:.1f} mm")

    figure, axes = plt.subplots(figsize=(6, 5))
    draw_table(axes, "move to the goal")
    draw_nodes(axes, before.nodes_world, "o-", "before")
    draw_nodes(axes, after.nodes_world, "o-", "after")
    draw_nodes(axes, goal.nodes_world, "k--", "goal")
    axes.legend()
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("08_move_to_goal.png", example, start="I")
