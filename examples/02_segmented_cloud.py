"""Fig. 5b: the DLO's points after segmentation and box filter, and a change of the filters during a run."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_lab import draw_points, draw_table, looked, result_of, run_example

from dlokit.skills.perception import api as perception
from dlokit.system.lockstep import LockstepSystem


async def example(system: LockstepSystem, picture: Path) -> None:
    whole = await looked(system)
    # A skill call sets a smaller box; the next look uses it.
    lower, upper = np.array([0.3, 0.0, -0.01]), np.array([0.75, 0.4, 0.1])
    result_of(await system.transport.call(perception.SET_BOX, lower, upper))
    await system.clock.sleep(0.1)
    half = await looked(system)
    print(f"{len(whole.points_world)} points of the DLO; {len(half.points_world)} of them in the smaller box")

    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 5))
    for axes, seen, title in ((left, whole, "segmented cloud"), (right, half, "box cut at y = 0")):
        draw_table(axes, title)
        draw_points(axes, seen.points_world, "DLO")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("02_segmented_cloud.png", example)
