"""Fig. 5g: move above the grasp point in joint space, descend, close the fingers, and check that the DLO is held."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_lab import result_of, run_example
from example_steps import goal_named, proposed, tracked_state

from dlokit.functional.cell import api as cell
from dlokit.geometry import matrix, pose_from_matrix
from dlokit.skills.robot import api as robot
from dlokit.system.lockstep import LockstepSystem

ABOVE_M = 0.06


async def example(system: LockstepSystem, picture: Path) -> None:
    goal = await goal_named(system, "I")
    state = await tracked_state(system, goal)
    action = await proposed(system, state, goal, np.array([], dtype=np.int64))
    above = matrix(action.grasp.T_world_tcp)
    above[2, 3] += ABOVE_M

    pictures = [result_of(await system.transport.call(cell.CAPTURE)).left]
    result_of(await system.transport.call(robot.RELEASE, action.grasp.opening_m))
    moved = result_of(await system.transport.call(robot.MOVE_TO, pose_from_matrix(above)))
    pictures.append(result_of(await system.transport.call(cell.CAPTURE)).left)
    result_of(await system.transport.call(robot.MOVE_LINEAR, action.grasp.T_world_tcp, action.velocity))
    grip = result_of(await system.transport.call(robot.GRASP, 20.0))
    pictures.append(result_of(await system.transport.call(cell.CAPTURE)).left)
    print(f"there in {moved.duration_s:.2f} s; fingers {grip.width_m * 1e3:.1f} mm apart, held: {grip.held}")

    figure, axes = plt.subplots(1, 3, figsize=(13, 4))
    for ax, shown, title in zip(axes, pictures, ("before", "above the grasp point", "grasped"), strict=True):
        ax.imshow(shown)
        ax.set_title(title)
        ax.axis("off")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("07_move_and_grasp.png", example)
