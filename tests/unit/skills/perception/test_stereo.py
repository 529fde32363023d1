import numpy as np
import pytest
from numpy.typing import NDArray
from stereo_scene import HEIGHT_PX, WIDTH_PX, Scene, calibration

from dlokit.geometry.camera import back_project, baseline_m, plane_disparity
from dlokit.skills.perception import stereo
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.config import StereoConfig
from dlokit.skills.perception.rectification import grey
from dlokit.skills.perception.stereo import Disparity, StereoMatcher
from dlokit.types.image import Image

CAMERA = calibration()
MIDDLE = (slice(200, 320), slice(200, 440))


def textured_plane(height_m: float) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Images of a textured plane at a height, generated from its disparity."""
    rng = np.random.default_rng(0)
    coarse = rng.uniform(40, 220, (HEIGHT_PX, WIDTH_PX // 4 + 100))
    v, u = np.mgrid[0:HEIGHT_PX, 0:WIDTH_PX].astype(float)
    plane = plane_disparity(CAMERA, height_m)

    def texture(columns: NDArray[np.float64]) -> NDArray[np.uint8]:
        s = np.clip((columns + 150.0) / 4.0, 0, coarse.shape[1] - 1.001)
        whole = s.astype(int)
        rows = v.astype(int)
        part = s - whole
        return ((1 - part) * coarse[rows, whole] + part * coarse[rows, whole + 1]).astype(np.uint8)

    # Right column x shows what the left one shows at u = x + d(u): u = (x + b v + c) / (1 - a).
    seen_at = (u + plane.per_v * v + plane.constant) / (1.0 - plane.per_u)
    return texture(u), texture(seen_at)


@pytest.mark.parametrize("height_m", [0.0, 0.03, 0.15])
def test_a_textured_plane_is_found_at_its_height(height_m: float):
    left, right = textured_plane(height_m)
    mask = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.bool_)
    mask[MIDDLE] = True
    found = StereoMatcher(StereoConfig()).match(left, right, mask, mask | True, CAMERA)
    assert found is not None
    rows, columns = np.nonzero(np.isfinite(found.pixels))
    assert len(rows) > 0.95 * mask.sum()
    pixels = np.column_stack([columns + found.window.left, rows + found.window.top])
    depth = CAMERA.fx_px * baseline_m(CAMERA) / found.pixels[rows, columns].astype(np.float64)
    heights = back_project(pixels, depth, CAMERA)[:, 2]
    # Disparities are biased towards whole pixels by up to 0.15 px of 60 px: at 1.2 m, 3 mm along the line of sight.
    assert abs(np.median(heights) - height_m) < 0.003


def test_only_masked_pixels_have_a_disparity(s_scene: Scene):
    left, right = grey(s_scene.images.left), grey(s_scene.images.right)
    bright = BrightnessConfig().build()
    mask, mask_right = (bright.mask(Image(stamp_ns=0, pixels=p)).pixels for p in (left, right))
    mask[:, 500:] = False
    found = StereoMatcher(StereoConfig()).match(left, right, mask, mask_right, CAMERA)
    assert found is not None
    w = found.window
    assert not np.isfinite(found.pixels[~mask[w.top : w.bottom, w.left : w.right]]).any()
    assert (w.right - w.left) * (w.bottom - w.top) < 0.25 * WIDTH_PX * HEIGHT_PX  # only where it matters


def test_an_empty_mask_needs_no_matching():
    nothing = np.zeros((HEIGHT_PX, WIDTH_PX), dtype=np.bool_)
    left, right = textured_plane(0.0)
    assert StereoMatcher(StereoConfig()).match(left, right, nothing, nothing, CAMERA) is None


def test_smoothing_lowers_the_noise_and_leaves_the_mean(s_scene: Scene, monkeypatch: pytest.MonkeyPatch):
    left, right = grey(s_scene.images.left), grey(s_scene.images.right)
    mask = BrightnessConfig().build().mask(Image(stamp_ns=0, pixels=left)).pixels
    mask[:, 500:] = False
    found: list[Disparity | None] = []
    for px in (1, 9):
        monkeypatch.setattr(stereo, "SMOOTHING_PX", px)
        found.append(StereoMatcher(StereoConfig()).match(left, right, mask, mask, CAMERA))
    assert found[0] is not None
    assert found[1] is not None
    w = found[0].window
    v, u = np.mgrid[w.top : w.bottom, w.left : w.right].astype(float)
    rough, smooth = (d.pixels - plane_disparity(CAMERA, 0.004).at(u, v) for d in found if d is not None)
    assert np.nanstd(smooth) < 0.9 * np.nanstd(rough)
    assert abs(np.nanmean(smooth) - np.nanmean(rough)) < 0.05  # 1 mm
