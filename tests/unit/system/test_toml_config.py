"""Configuration round trips through TOML, and says what is wrong with it."""

from dataclasses import dataclass, field

import pytest

from dlokit.errors import ConfigError
from dlokit.system.toml_config import from_toml, to_toml


@dataclass(frozen=True)
class Round:
    radius_m: float = 0.1


@dataclass(frozen=True)
class Square:
    side_m: float = 0.2


@dataclass(frozen=True)
class Tree:
    shape: Round | Square = field(default_factory=Round)
    corner: tuple[float, float] = (0.0, 1.0)
    name: str | None = None
    nested: Square = field(default_factory=Square)


def test_a_configuration_survives_the_round_trip_whichever_strategy_it_holds() -> None:
    for tree in (Tree(), Tree(shape=Square(side_m=0.3), corner=(1.0, 2.0), name="x")):
        assert from_toml(to_toml(tree), Tree, "test") == tree


def test_an_unknown_key_is_named_beside_the_allowed_ones() -> None:
    with pytest.raises(ConfigError, match=r"sid_m.*allowed: side_m"):
        from_toml("[nested]\nsid_m = 1.0\n", Tree, "test")


def test_an_unknown_strategy_is_named_beside_the_allowed_ones() -> None:
    with pytest.raises(ConfigError, match="'Oval'; allowed: Round, Square"):
        from_toml('[shape]\nkind = "Oval"\n', Tree, "test")


def test_a_value_of_the_wrong_type_is_named_by_its_path() -> None:
    with pytest.raises(ConfigError, match=r"test: nested: side_m.*'wide'"):
        from_toml('[nested]\nside_m = "wide"\n', Tree, "test")


def test_text_that_is_no_toml_is_one_clear_error() -> None:
    with pytest.raises(ConfigError, match="test is not TOML"):
        from_toml("= 3", Tree, "test")
