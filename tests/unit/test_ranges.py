"""Values outside the ranges that stand beside their types are refused, with what is allowed."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta

from dlokit.errors import ConfigError
from dlokit.ranges import Count, NotNegative, NumericSetting, Positive, check_ranges, numeric_settings


@dataclass(frozen=True, kw_only=True)
class Settings:
    pause_s: Positive = 0.1
    scale: Annotated[float, Meta(ge=0.05, le=1.0)] = 1.0
    looks: Count = 1
    limit_m: Positive | None = None
    corner_m: tuple[float, float] = (0.0, 0.0)
    factors: tuple[NotNegative, ...] = ()
    side: Literal["left", "right"] = "left"
    threshold_m: Annotated[float, Meta(gt=0.0, le=0.1)] = 0.012

    def __post_init__(self) -> None:
        check_ranges(self, "look")


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"pause_s": 0.0}, "--look.pause-s is 0.0; it must be above 0."),
        ({"pause_s": float("nan")}, "--look.pause-s is nan; it must be above 0."),
        ({"pause_s": float("inf")}, "--look.pause-s is inf; it must be a finite number."),
        ({"scale": 1.1}, "--look.scale is 1.1; it must be 0.05 to 1."),
        ({"looks": 0}, "--look.looks is 0; it must be 1 or greater."),
        ({"limit_m": -1.0}, "--look.limit-m is -1.0; it must be above 0."),
        ({"corner_m": (0.0, float("nan"))}, "--look.corner-m is (0.0, nan); it must be a finite number in each value."),
        ({"factors": (1.0, -1.0)}, "--look.factors is (1.0, -1.0); it must be 0 or greater in each value."),
        ({"side": "above"}, "--look.side is above; it must be one of left, right."),
        ({"threshold_m": 12.0}, "--look.threshold-m is 12.0; it must be above 0 and at most 0.1."),
    ],
)
def test_a_value_out_of_its_range_is_refused_with_what_is_allowed(values: dict[str, Any], says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        Settings(**values)
    assert str(refused.value) == says


def test_values_at_their_bounds_and_without_a_value_are_taken() -> None:
    Settings(scale=0.05, looks=1, limit_m=None, factors=(0.0,), threshold_m=0.1)


@dataclass(frozen=True)
class SliderSettings:
    name = "not a setting"

    level: Annotated[int, Meta(ge=0, le=255)] = 80
    """A level,
    in two lines."""
    scale: Annotated[float, Meta(gt=0.0, lt=1.0)] = 0.5
    free: float = 1.0
    on: bool = True
    side: Literal["left", "right"] = "left"
    limit_m: Positive | None = None


def test_the_numbers_among_settings_have_their_declared_ranges_and_texts() -> None:
    assert numeric_settings(SliderSettings) == (
        NumericSetting(name="level", whole=True, least=0, most=255, text="A level, in two lines."),
        NumericSetting(name="scale", whole=False, least=0.0, most=1.0, text=""),
        NumericSetting(name="free", whole=False, least=None, most=None, text=""),
    )
