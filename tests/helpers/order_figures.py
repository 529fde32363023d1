"""How often a cloud is ordered correctly without a prior, by class: a script, and functions for tests.

python tests/helpers/order_figures.py [seeds] [first seed]
"""

import sys
import time
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from tangled_rods import LENGTH_M, Scene, order_error_m, tangled

from dlokit.errors import SkillFailure
from dlokit.skills.observer.initialise.first_shape import initial_targets

RIGHT_M = 0.012  # a little over a node spacing: an order that is wrong anywhere is off by several

ON_TABLE = {
    "plain": Scene(),
    "gap": Scene(gaps=1),
    "three gaps": Scene(gaps=3),
    "outliers": Scene(outliers=0.05),
    "crossing": Scene(crossings=1),
    "two crossings": Scene(crossings=2),
    "crossing, gap, outliers": Scene(crossings=1, gaps=1, outliers=0.05),
    "two crossings, two gaps, outliers": Scene(crossings=2, gaps=2, outliers=0.05),
}
SCENES = ON_TABLE | {f"lifted, {name}": replace(scene, spatial=True) for name, scene in ON_TABLE.items()}


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Results of the seeds of one class."""

    right: float
    """Fraction of the seeds whose nodes are in order."""
    wrong: float
    """Fraction of the seeds with a wrong order and no reported failure."""
    failures: Counter[str]
    seconds: list[float]
    """Processor time of each seed [s]."""


def figures(scene: Scene, seeds: range) -> Figures:
    """Order the clouds of a class."""
    right, wrong, failures, seconds = 0, 0, Counter[str](), []
    for seed in seeds:
        curve, seen = tangled(scene, seed)
        began = time.process_time()
        try:
            result = initial_targets(seen, 50, LENGTH_M)
        except SkillFailure as failure:
            failures[failure.reason] += 1
        else:
            good = order_error_m(result.nodes_world, curve) < RIGHT_M
            right, wrong = right + good, wrong + (not good)
        seconds.append(time.process_time() - began)
    return Figures(right=right / len(seeds), wrong=wrong / len(seeds), failures=failures, seconds=seconds)


if __name__ == "__main__":
    count, first = (int(word) for word in (sys.argv[1:] + ["100", "1000"][len(sys.argv) - 1 :])[:2])
    for name, scene in SCENES.items():
        found = figures(scene, range(first, first + count))
        ms = 1e3 * np.array(found.seconds)
        print(
            f"{name:42} right {found.right:6.1%}  wrong {found.wrong:6.1%}  p50 {np.median(ms):3.0f} ms  "
            f"max {ms.max():3.0f} ms  {dict(found.failures)}",
            flush=True,
        )
