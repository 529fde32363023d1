"""Statistics of a data set, which learning code uses to scale the features."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dlokit.extras.export.pictures import Shot
from dlokit.types.arrays import UInt8Array

Stats = dict[str, dict[str, NDArray[Any]]]
"""min, max, mean, std, count and quantiles by feature, (n,), or (channels, 1, 1) of pictures."""

DEPTH_VIEW = "depth"
"""The view of depths."""
PICTURES_OF_STATS = 20
"""Maximum number of pictures per episode that its statistics are computed from."""
PIXELS_OF_STATS = 4
"""The statistics use every n-th pixel along each side."""
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


def stats_of_rows(rows: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Statistics (n,) of rows (T, n)."""
    found = {"min": rows.min(0), "max": rows.max(0), "mean": rows.mean(0), "std": rows.std(0)}
    quantiles = np.quantile(rows, list(_QUANTILES.values()), axis=0)
    return found | {"count": np.array([len(rows)])} | dict(zip(_QUANTILES, quantiles, strict=True))


class PictureSamples:
    """Pictures of an episode, for its statistics."""

    def __init__(self, length: int) -> None:
        self._every = max(1, length // PICTURES_OF_STATS)
        self._pixels: dict[str, list[UInt8Array]] = {}
        self._depths: list[NDArray[Any]] = []
        self._length = length

    def add(self, number: int, shot: Shot) -> None:
        """Sample the pictures of a frame."""
        if number % self._every:
            return
        for name, view in shot.views.items():
            self._pixels.setdefault(name, []).append(view[::PIXELS_OF_STATS, ::PIXELS_OF_STATS])
        if shot.depth_m is not None:
            self._depths.append(shot.depth_m[::PIXELS_OF_STATS, ::PIXELS_OF_STATS])

    def stats(self) -> Stats:
        """By view, (channels, 1, 1): colours from 0 to 1, `DEPTH_VIEW` in millimetres, as in the loaded data set."""
        colours = {name: np.stack(of).reshape(-1, 3) / 255.0 for name, of in self._pixels.items()}
        depths = {DEPTH_VIEW: np.round(np.stack(self._depths).reshape(-1, 1) * 1e3)} if self._depths else {}
        found: Stats = {}
        for name, pixels in (colours | depths).items():
            of = stats_of_rows(pixels)
            found[name] = {key: value[:, None, None] for key, value in of.items() if key != "count"}
            found[name]["count"] = np.array([self._length])
        return found


def stats_of_all(episodes: Sequence[Stats]) -> Stats:
    """The statistics of all frames from the episodes' statistics; quantiles are the episodes' weighted means."""
    return {name: _merged([stats[name] for stats in episodes]) for name in episodes[0]}


def _merged(parts: Sequence[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    counts = np.array([part["count"][0] for part in parts], dtype=np.float64)

    def weighted(values: Sequence[NDArray[Any]]) -> NDArray[Any]:
        return np.average(np.stack(values), axis=0, weights=counts)

    mean = weighted([part["mean"] for part in parts])
    variance = weighted([part["std"] ** 2 + (part["mean"] - mean) ** 2 for part in parts])
    return {
        "min": np.min([part["min"] for part in parts], axis=0),
        "max": np.max([part["max"] for part in parts], axis=0),
        "mean": mean,
        "std": np.sqrt(variance),
        "count": np.array([round(counts.sum())]),
        **{name: weighted([part[name] for part in parts]) for name in _QUANTILES},
    }
