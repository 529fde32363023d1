"""A click on a DLO proposes settings that find it, and nothing where it meant no DLO."""

from dataclasses import dataclass
from typing import ClassVar

import cv2
import numpy as np
import pytest

from dlokit.geometry import pose
from dlokit.skills.perception.base import Segmentation
from dlokit.skills.perception.brightness import Brightness, BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import from_spec
from dlokit.skills.perception.pipeline import segmented
from dlokit.skills.perception.proposal import clicked_dlo, proposed
from dlokit.types.arrays import BoolArray, UInt8Array
from dlokit.types.image import CameraCalibration, DepthImage

Rgb = tuple[int, int, int]
BLUE, WHITE, BLACK, RED, ORANGE = (30, 60, 160), (235, 235, 230), (25, 25, 25), (190, 30, 30), (230, 120, 30)
WOOD, DARK, LIGHT, GREEN = (170, 130, 90), (45, 45, 50), (200, 200, 195), (60, 110, 60)
HEIGHT, WIDTH = 240, 320
CLICK = (150, 97)  # on the middle line of the DLO


def drawn(dlo: Rgb, table: Rgb, width_px: int) -> tuple[UInt8Array, BoolArray]:
    """A wavy DLO on a table lit from one side, with soft edges and noise (HEIGHT, WIDTH, 3); and its pixels."""
    line = np.column_stack([np.arange(WIDTH), 120 + 40 * np.sin(np.arange(WIDTH) / 40.0)]).round().astype(np.int32)
    picture, truth = np.full((HEIGHT, WIDTH, 3), table, dtype=np.float64), np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    cv2.polylines(picture, [line], False, dlo, width_px, cv2.LINE_AA)
    cv2.polylines(truth, [line], False, (1.0,), width_px)
    picture = cv2.GaussianBlur(picture, (3, 3), 0.0) * (1.0 + 0.25 * np.linspace(-1.0, 1.0, WIDTH))[None, :, None]
    picture += np.random.default_rng(0).normal(0.0, 4.0, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8), truth > 0


def taken(picture: UInt8Array) -> DepthImage:
    calibration = CameraCalibration(
        width_px=WIDTH,
        height_px=HEIGHT,
        fx_px=300.0,
        fy_px=300.0,
        cx_px=160.0,
        cy_px=120.0,
        T_world_camera=pose((0, 0, 1)),
    )
    return DepthImage(
        stamp_ns=1, pixels=picture, depth_m=np.ones((HEIGHT, WIDTH), dtype=np.float32), calibration=calibration
    )


def overlap(mask: BoolArray, truth: BoolArray) -> float:
    return float(np.count_nonzero(mask & truth) / np.count_nonzero(mask | truth))


@pytest.mark.parametrize("off_px", [0, 4])
@pytest.mark.parametrize(
    ("dlo", "table", "width_px", "name"),
    [
        (BLUE, WOOD, 6, "colour"),
        (RED, GREEN, 3, "colour"),
        (ORANGE, WOOD, 30, "colour"),
        (WHITE, DARK, 3, "brightness"),
        (WHITE, DARK, 30, "brightness"),
        (BLACK, LIGHT, 6, "brightness"),
    ],
)
def test_a_click_on_or_beside_a_dlo_proposes_settings_that_find_it(
    dlo: Rgb, table: Rgb, width_px: int, name: str, off_px: int
) -> None:
    picture, truth = drawn(dlo, table, width_px)
    proposal = proposed(taken(picture), (CLICK[0], CLICK[1] + off_px), BrightnessConfig())
    assert proposal.spec is not None, proposal.text
    assert proposal.spec.name == name
    # The outline of the drawn truth is one pixel wider than the soft edge: of 6 px the mask takes 5.
    assert overlap(segmented(picture, from_spec(proposal.spec).build()), truth) > 0.7


def test_a_click_near_the_edge_of_a_thick_dlo_means_the_dlo() -> None:
    picture, truth = drawn(WHITE, DARK, 30)
    assert overlap(clicked_dlo(picture, (CLICK[0], CLICK[1] + 12)), truth) > 0.5  # the rest is farther than is followed


def test_a_click_on_the_table_proposes_nothing_and_says_what_to_do() -> None:
    picture, _ = drawn(BLUE, WOOD, 6)
    proposal = proposed(taken(picture), (160, 220), BrightnessConfig())
    assert proposal.spec is None
    assert "click on the DLO" in proposal.text


def test_a_coloured_dlo_is_found_by_colour_where_brightness_would_do_as_well() -> None:
    picture, _ = drawn(BLUE, LIGHT, 6)
    for settings in (BrightnessConfig(), ColourConfig()):
        proposal = proposed(taken(picture), CLICK, settings)
        assert proposal.spec is not None
        assert proposal.spec.name == "colour"


def test_a_grey_dlo_has_no_colour() -> None:
    assert ColourConfig().proposed(np.array([[25, 25, 27], [30, 28, 30]], dtype=np.uint8)) is None


def test_a_range_of_hues_passes_through_red() -> None:
    found = ColourConfig().proposed(np.array([[200, 20, 30], [200, 30, 20]] * 10, dtype=np.uint8))
    assert found is not None
    assert found.lowest_hue_deg > 340.0
    assert found.highest_hue_deg < 20.0


@dataclass(frozen=True, kw_only=True)
class OwnConfig:
    name: ClassVar[str] = "own"

    def build(self) -> Segmentation:
        return Brightness(BrightnessConfig())


def test_a_strategy_without_proposals_says_so_and_names_those_that_have_them() -> None:
    picture, _ = drawn(BLUE, WOOD, 6)
    proposal = proposed(taken(picture), CLICK, OwnConfig())
    assert proposal.spec is None
    assert proposal.text == "“own” proposes nothing from a click: move its sliders, or choose brightness or colour."


@pytest.mark.parametrize("pixel", [(WIDTH, 0), (0, HEIGHT)])
def test_a_pixel_outside_the_picture_is_refused(pixel: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match="320 columns and 240 rows"):
        proposed(taken(drawn(BLUE, WOOD, 6)[0]), pixel, BrightnessConfig())
