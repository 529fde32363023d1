"""Configuration round trips through TOML, and errors in a configuration are named."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar

import pytest

from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.configuration.toml_config import from_plain, from_toml, known_part, to_plain, to_toml


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


@dataclass(frozen=True)
class Near:
    name: ClassVar[str] = "near"
    radius_m: float = 0.1


@dataclass(frozen=True)
class Far:
    name: ClassVar[str] = "far"


KIND: StrategyKind[NamedConfig] = StrategyKind("observer", "dlokit.nobodys_strategies", (Near, Far))


@dataclass(frozen=True)
class Chosen:
    strategy: Annotated[NamedConfig, KIND] = field(default_factory=Near)


def test_a_strategy_is_kept_by_its_name_whichever_class_it_is_of() -> None:
    text = to_toml(Chosen(Near(radius_m=0.2)))
    assert text == '[strategy]\nkind = "near"\nradius_m = 0.2\n'
    assert from_toml(text, Chosen, "test") == Chosen(Near(radius_m=0.2))
    assert from_toml(to_toml(Chosen(Far())), Chosen, "test") == Chosen(Far())


def test_a_strategy_that_is_not_installed_is_refused_with_the_installed_ones() -> None:
    with pytest.raises(ConfigError, match="'lost'; allowed: near, far; is a package missing"):
        from_toml('[strategy]\nkind = "lost"\n', Chosen, "test")


def test_a_strategy_that_no_file_could_name_is_not_written() -> None:
    @dataclass(frozen=True)
    class Unknown:
        name: ClassVar[str] = "near"

    with pytest.raises(ConfigError, match="Unknown is none of near, far"):
        to_toml(Chosen(Unknown()))


def test_a_configuration_survives_the_round_trip_whichever_strategy_it_holds() -> None:
    for tree in (Tree(), Tree(shape=Square(side_m=0.3), corner=(1.0, 2.0), name="x")):
        assert from_toml(to_toml(tree), Tree, "test") == tree


def test_an_unknown_key_is_refused_with_the_allowed_ones() -> None:
    with pytest.raises(ConfigError, match=r"test: nested: unknown key moon; allowed: side_m"):
        from_toml("[nested]\nmoon = 1.0\n", Tree, "test")
    with pytest.raises(ConfigError, match=r"sid_m \(did you mean side_m\?\); allowed: side_m"):
        from_plain({"nested": {"sid_m": 1.0}}, Tree, "settings")


def test_an_unknown_strategy_is_refused_with_the_allowed_ones() -> None:
    with pytest.raises(ConfigError, match="'Oval'; allowed: Round, Square"):
        from_toml('[shape]\nkind = "Oval"\n', Tree, "test")


def test_a_value_of_the_wrong_type_is_named_by_its_path() -> None:
    with pytest.raises(ConfigError, match=r"test: nested: side_m.*'wide'"):
        from_toml('[nested]\nside_m = "wide"\n', Tree, "test")


def test_invalid_toml_is_one_clear_error() -> None:
    with pytest.raises(ConfigError, match="test is not TOML"):
        from_toml("= 3", Tree, "test")


def test_the_known_part_of_another_versions_file_is_separated() -> None:
    plain = to_plain(RunConfig(seed=3))
    assert known_part(plain, RunConfig) == (plain, [])
    older = {**plain, "gone": 1, "model": {**plain["model"], "gone": 2}}
    older["observer"] = {**plain["observer"], "strategy": {**plain["observer"]["strategy"], "gone": {"deep": 3}}}
    known, unknown = known_part(older, RunConfig)
    assert known == plain
    assert set(unknown) == {"model.gone", "observer.strategy.gone", "gone"}


def test_a_file_of_another_version_is_refused_with_all_removed_settings() -> None:
    text = "[shape]\nkind = 'Round'\nsides = 4\n[nested]\ncolour = 'red'\n[lid]\nopen = true\n"
    with pytest.raises(ConfigError, match=r"shape\.sides, nested\.colour, lid"):
        from_toml(text, Tree, "test")


def test_a_value_out_of_its_range_names_the_file_and_the_setting() -> None:
    with pytest.raises(ConfigError, match=r"old\.toml.*--task\.max-time-s is -1\.0; it must be above 0"):
        from_toml("[task]\nmax_time_s = -1.0\n", RunConfig, "old.toml")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "[task]\ntreshold_m = 0.01\nspeed_scale = 0.5\n",
            "mine.toml: there is no setting task.treshold_m (perhaps you meant task.threshold_m), task.speed_scale "
            "(speed_scale is gate.speed_scale)",
        ),
        (
            "[task]\nspeed_scale = 0.5\n",
            "mine.toml: there is no setting task.speed_scale (speed_scale is gate.speed_scale)",
        ),
        ("[tsk]\nthreshold_m = 0.01\n", "mine.toml: there is no setting tsk (perhaps you meant task)"),
        ("[observer.strategy]\nkind = 'map'\nnois_m = 1.0\n", "perhaps you meant observer.strategy.noise_m"),
        (
            "[viewer]\nthreshold_m = 0.01\nforce_n = 1.0\n",
            "viewer.threshold_m (threshold_m is task.threshold_m), viewer.force_n",
        ),
        (
            "[task]\nlength_m = 1.0\n",
            "mine.toml: task: unknown key length_m; allowed",
        ),  # that of the DLO or of the model
        (
            "[task]\nmoon = 1\nstars = 2\n",
            "this version has no settings task.moon, task.stars: it is the file of another",
        ),
    ],
)
def test_an_unknown_setting_in_a_file_is_answered_with_what_was_probably_meant(text: str, says: str) -> None:
    with pytest.raises(ConfigError) as caught:
        from_toml(text, RunConfig, "mine.toml")
    assert says in str(caught.value)
    assert "another" not in str(caught.value) or "moon" in text


def test_any_part_of_a_configuration_is_a_file_of_settings() -> None:
    config = from_toml("task.threshold_m = 0.008\n[gate]\nspeed_scale = 0.5\n", RunConfig, "mine.toml")
    assert (config.task.threshold_m, config.gate.speed_scale) == (0.008, 0.5)
