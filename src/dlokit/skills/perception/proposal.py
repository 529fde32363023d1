"""Settings of a segmentation, proposed from a click on the DLO in a picture."""

import cv2
import numpy as np

from dlokit.skills.perception.base import ProposesSettings, SegmentationConfig
from dlokit.skills.perception.config import SEGMENTATIONS, to_spec
from dlokit.skills.perception.pipeline import LARGEST_SHARE, segmented
from dlokit.skills.perception.rectification import rectified
from dlokit.types.arrays import BoolArray, UInt8Array
from dlokit.types.image import CameraPictures
from dlokit.types.system import StrategyProposal

Pixel = tuple[int, int]
"""Column and row [px]."""

_WINDOW_PX = 20
"""Half the side of the square around the click in which the background is looked for; wider than most DLOs."""
_REACH_PX = 5
"""A click beside a DLO by at most this is meant for it: a thin DLO is 3 px wide on the page."""
_LEAST_PX = 60
"""A smaller patch is a speck, or a highlight of a thick DLO; a thin DLO of 3 px has 120 in the square."""
_TWO_COLOURS = 0.85
"""Least fraction of the square that a thin DLO and its background fill; the rest is the mixed colour of the edges."""
_DISTINCT = 20.0
"""Least distance in Lab (8 bits a channel) of a DLO from the background beside it; noise and shades are about 10."""
_FLOOD_PX = 120
"""Half the side of the square in which the clicked DLO is followed."""
_SAME = (50, 14, 14)
"""Largest differences of lightness, a and b in Lab along a DLO from the clicked pixel: light from above changes its
lightness more than its colour."""


def proposed(images: CameraPictures, at: Pixel, settings: SegmentationConfig) -> StrategyProposal:
    """Propose settings that find the DLO that was clicked on, at the pixel `at` of the rectified picture.

    Of the strategies by colour and by brightness, and the one of `settings`, the strategy is proposed that takes the
    fewest other pixels. Nothing is proposed when `settings` are of a strategy that cannot be set by a click. Raises
    `ValueError` for a pixel outside the picture.
    """
    picture = rectified(images).reference
    rgb = picture if picture.ndim == 3 else np.repeat(picture[..., None], 3, axis=2)
    height, width = rgb.shape[:2]
    if not (0 <= at[0] < width and 0 <= at[1] < height):
        raise ValueError(f"pixel {at[0]}, {at[1]} is outside the picture; it has {width} columns and {height} rows")
    if not isinstance(settings, ProposesSettings):
        others = " or ".join(name for name, kind in SEGMENTATIONS.installed().items() if _can(kind))
        return StrategyProposal(
            spec=None, text=f"“{settings.name}” proposes nothing from a click: move its sliders, or choose {others}."
        )
    dlo = clicked_dlo(rgb, at)
    if np.mean(dlo[_around(at, _FLOOD_PX, rgb)]) > LARGEST_SHARE:
        return StrategyProposal(
            spec=None, text="Nothing is proposed: what was clicked on fills its surroundings; click on the DLO itself."
        )
    # At a tie the present strategy where it is another package's, then colour, which depends less on the light.
    ours = {kind.name: kind() for kind in reversed(SEGMENTATIONS.builtin)}
    starts = ({} if settings.name in ours else {settings.name: settings}) | ours | {settings.name: settings}
    found = [each.proposed(rgb[dlo]) for each in starts.values() if isinstance(each, ProposesSettings)]
    candidates = [each for each in found if each is not None]
    if not candidates:
        return StrategyProposal(spec=None, text="Nothing is proposed: neither the colour nor the brightness is known.")
    others_px = [int(np.count_nonzero(segmented(rgb, each.build()) & ~dlo)) for each in candidates]
    best = candidates[int(np.argmin(others_px))]
    return StrategyProposal(
        spec=to_spec(best),
        text=f"Proposed from {np.count_nonzero(dlo)} pixels around the click: segmentation by {best.name}.",
    )


def _can(kind: type[SegmentationConfig]) -> bool:
    return callable(getattr(kind, "proposed", None))


def clicked_dlo(rgb: UInt8Array, at: Pixel) -> BoolArray:
    """The pixels (height, width) of the DLO that a click at `at` in a picture (height, width, 3) meant.

    They are connected, and have the colour of the clicked pixel, or of the thin DLO that is nearest to it.
    """
    lab = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2LAB), dtype=np.uint8)
    thin = _thin_dlo(lab, at)
    return _followed(lab, at) if thin is None else thin


def _thin_dlo(lab: UInt8Array, at: Pixel) -> BoolArray | None:
    """The pixels (height, width) of a DLO near `at` that is thinner than its background; None where there is none.

    A click misses a thin DLO easily, or hits its edge, whose colour is mixed: its pixel is the one near the click that
    differs most from the background.
    """
    background = np.median(lab[_around(at, _WINDOW_PX, lab)].reshape(-1, 3), axis=0)
    near = _around(at, _REACH_PX, lab)
    off = np.linalg.norm(lab[near].astype(np.float64) - background, axis=2)
    row, column = np.unravel_index(int(np.argmax(off)), off.shape)
    if off[row, column] < _DISTINCT:
        return None
    found = _followed(lab, (near[1].start + int(column), near[0].start + int(row)))
    like_background = np.all(np.abs(lab - background) <= _SAME, axis=2)
    window, wide = _around(at, _WINDOW_PX, lab), _around(at, _FLOOD_PX, lab)
    # Around a click on a thick DLO, the thick DLO is the background, and what differs is the table, or the mixed colour
    # of the edge, which is not all that there is beside the DLO.
    thin = np.count_nonzero(found) < np.count_nonzero(like_background[wide])
    alone = np.mean((found | like_background)[window]) > _TWO_COLOURS
    return found if thin and alone and np.count_nonzero(found) >= _LEAST_PX else None


def _followed(lab: UInt8Array, at: Pixel) -> BoolArray:
    """The pixels (height, width) connected with `at`, not farther than `_FLOOD_PX`, that have its colour."""
    part = _around(at, _FLOOD_PX, lab)
    seed = (at[0] - part[1].start, at[1] - part[0].start)
    inside = np.ascontiguousarray(lab[part])
    mask = np.zeros((inside.shape[0] + 2, inside.shape[1] + 2), dtype=np.uint8)
    flags = 8 | cv2.FLOODFILL_FIXED_RANGE | cv2.FLOODFILL_MASK_ONLY | (1 << 8)
    cv2.floodFill(inside, mask, seed, (0.0, 0.0, 0.0), _SAME, _SAME, flags)
    found = np.zeros(lab.shape[:2], dtype=np.bool_)
    found[part] = mask[1:-1, 1:-1] > 0
    return found


def _around(at: Pixel, reach_px: int, picture: UInt8Array) -> tuple[slice, slice]:
    """Rows and columns of the square around `at`, cut at the picture's edges."""
    (u, v), (height, width) = at, picture.shape[:2]
    return (
        slice(max(v - reach_px, 0), min(v + reach_px + 1, height)),
        slice(max(u - reach_px, 0), min(u + reach_px + 1, width)),
    )
