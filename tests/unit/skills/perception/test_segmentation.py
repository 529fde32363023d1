import numpy as np
import pytest

from dlokit.errors import SkillRejected
from dlokit.skills.perception.brightness import BrightnessConfig
from dlokit.skills.perception.colour import ColourConfig
from dlokit.skills.perception.config import from_spec, to_spec
from dlokit.types.image import Image
from dlokit.types.system import StrategySpec

BLACK, WHITE, RED, GREEN = (0, 0, 0), (255, 255, 255), (230, 10, 10), (10, 200, 10)


def picture(*colours: tuple[int, int, int]) -> Image:
    return Image(stamp_ns=0, pixels=np.array([colours], dtype=np.uint8))


def test_brightness_keeps_what_is_between_its_bounds_the_bounds_included():
    grey = Image(stamp_ns=0, pixels=np.array([[99, 100, 150, 200, 201]], dtype=np.uint8))
    mask = BrightnessConfig(lowest=100, highest=200).build().mask(grey)
    assert mask.pixels.tolist() == [[False, True, True, True, False]]


def test_brightness_sees_a_coloured_picture_by_its_grey_value():
    assert BrightnessConfig().build().mask(picture(BLACK, WHITE)).pixels.tolist() == [[False, True]]


def test_colour_keeps_its_hue_and_no_grey():
    green = ColourConfig(lowest_hue_deg=90, highest_hue_deg=150)
    assert green.build().mask(picture(GREEN, RED, WHITE, BLACK)).pixels.tolist() == [[True, False, False, False]]


def test_a_range_of_hues_may_contain_red():
    red = ColourConfig(lowest_hue_deg=340, highest_hue_deg=20)
    assert red.build().mask(picture(RED, GREEN)).pixels.tolist() == [[True, False]]


def test_a_grey_picture_has_no_coloured_pixels():
    grey = Image(stamp_ns=0, pixels=np.full((2, 3), 200, dtype=np.uint8))
    assert not ColourConfig().build().mask(grey).pixels.any()


@pytest.mark.parametrize("config", [BrightnessConfig(lowest=7, highest=9), ColourConfig(lowest_hue_deg=5.0)])
def test_a_strategy_is_encoded_as_a_named_spec(config: BrightnessConfig | ColourConfig):
    assert from_spec(to_spec(config)) == config


def test_settings_omitted_in_a_spec_have_their_defaults():
    assert from_spec(StrategySpec(name="brightness")) == BrightnessConfig()


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        (StrategySpec(name="magic"), "brightness, colour"),
        (StrategySpec(name="brightness", settings=b'{"lowset": 3}'), "lowset.*it has .*lowest.*highest"),
        (StrategySpec(name="brightness", settings=b'{"lowest": 300}'), "<= 255"),
        (StrategySpec(name="brightness", settings=b'{"lowest": "x"}'), "int"),
        (StrategySpec(name="brightness", settings=b"not json"), "settings"),
    ],
)
def test_a_bad_spec_is_refused_with_the_valid_settings(spec: StrategySpec, says: str):
    with pytest.raises(SkillRejected, match=says):
        from_spec(spec)
