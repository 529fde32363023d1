"""Fig. 5a: the complete cloud of the stereo camera, before segmentation."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from example_lab import result_of, run_example

from dlokit.functional.cell import api as cell
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.rectification import grey, rectified
from dlokit.skills.perception.stereo import StereoMatcher, reproject
from dlokit.system.lockstep import LockstepSystem


async def example(system: LockstepSystem, picture: Path) -> None:
    pair = rectified(result_of(await system.transport.call(cell.CAPTURE)))
    everything = np.ones(pair.left.shape[:2], dtype=np.bool_)
    disparity = StereoMatcher(PerceptionConfig().stereo).match(
        grey(pair.left), grey(pair.right), everything, everything, pair.calibration
    )
    assert disparity is not None
    points = reproject(disparity, pair.calibration)
    print(f"{len(points)} points; median height of the table {np.median(points[:, 2]) * 1e3:.1f} mm")

    figure, (left, cloud) = plt.subplots(1, 2, figsize=(11, 5))
    left.imshow(pair.left)
    left.set_title("left picture")
    left.axis("off")
    heights = cloud.scatter(points[::5, 1], points[::5, 0], c=points[::5, 2], s=1, vmin=-0.02, vmax=0.1)
    cloud.set(title="cloud from above", xlabel="y [m]", ylabel="x [m]", aspect="equal", xlim=(0.6, -0.6), ylim=(0, 1))
    figure.colorbar(heights, label="z [m]")
    figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    run_example("01_cloud.png", example)
