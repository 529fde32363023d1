"""Strategies of other packages come through entry points; one that is broken stops no other."""

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, get_args

import pytest
from installed_packages import install

from dlokit.communication.strategies import NamedConfig, StrategyKind
from dlokit.errors import ConfigError, SkillRejected
from dlokit.types.system import StrategySpec

GROUP = "dlokit.strategies_of_this_test"
CONFIG = '''
from dataclasses import dataclass
from typing import ClassVar

@dataclass(frozen=True)
class {cls}:
    """Theirs."""
    name: ClassVar[str] = "{name}"
    radius_m: float = 0.1
    """A radius [m]."""
    def __post_init__(self):
        if self.radius_m < 0:
            from dlokit.errors import ConfigError
            raise ConfigError("radius_m must not be negative")
'''


@dataclass(frozen=True)
class Ours:
    name: ClassVar[str] = "ours"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


def kind() -> StrategyKind[NamedConfig]:
    return StrategyKind("observer", GROUP, (Ours,))


def theirs(name: str, module: str) -> dict[str, str]:
    return {module: CONFIG.format(cls="TheirConfig", name=name)}


def test_an_installed_packages_strategy_is_named_after_ours_and_in_the_union(folder: Path) -> None:
    install(folder, "good-package", GROUP, {"near": "sk_good:TheirConfig"}, theirs("near", "sk_good"))
    strategies = kind()
    assert list(strategies.installed()) == ["ours", "near"]
    assert get_args(strategies.union()) == tuple(strategies.installed().values())
    assert get_args(strategies.names()) == ("ours", "near")
    config = strategies.from_spec(StrategySpec(name="near", settings=b'{"radius_m": 0.3}'))
    assert strategies.to_spec(config).name == "near"
    assert strategies.to_spec(config).settings == b'{"radius_m":0.3}'


def test_one_that_cannot_be_imported_is_left_out_with_a_line_that_names_package_and_reason(
    folder: Path, caplog: pytest.LogCaptureFixture
) -> None:
    install(
        folder,
        "bad-package",
        GROUP,
        {"bad": "sk_bad:C"},
        {"sk_bad": "raise ImportError('no libnear.so\\nin any folder')\n"},
    )
    install(folder, "good-package", GROUP, {"near": "sk_beside:TheirConfig"}, theirs("near", "sk_beside"))
    strategies = kind()
    assert list(strategies.installed()) == ["ours", "near"]
    strategies.installed()
    (line,) = caplog.records  # once, however often they are asked for
    assert line.levelno == logging.WARNING
    assert "bad-package 1.0" in line.getMessage()
    assert "ImportError: no libnear.so in any folder" in line.getMessage()
    assert "\n" not in line.getMessage()


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("def C(): pass\n", "is not a dataclass"),
        ("class C:\n    name = 'c'\n", "is not a dataclass"),
        ("from dataclasses import dataclass\n@dataclass(frozen=True)\nclass C:\n    x: int = 1\n", "has no name"),
    ],
)
def test_what_is_no_configuration_class_is_left_out_and_says_what_is_wanted(
    folder: Path, caplog: pytest.LogCaptureFixture, source: str, says: str
) -> None:
    module = f"sk_odd_{abs(hash(source))}"
    install(folder, "odd-package", GROUP, {"odd": f"{module}:C"}, {module: source})
    assert list(kind().installed()) == ["ours"]
    assert says in caplog.text
    assert "frozen dataclass" in caplog.text


def test_two_of_the_same_name_are_an_error_that_names_both(folder: Path) -> None:
    install(folder, "one-package", GROUP, {"near": "sk_one:TheirConfig"}, theirs("near", "sk_one"))
    install(folder, "two-package", GROUP, {"near": "sk_two:TheirConfig"}, theirs("near", "sk_two"))
    with pytest.raises(ConfigError, match=r"'near'.*sk_one:TheirConfig of one-package.*sk_two:TheirConfig of two-pack"):
        kind().installed()


def test_a_name_of_ours_cannot_be_taken(folder: Path) -> None:
    install(folder, "thief", GROUP, {"ours": "sk_thief:TheirConfig"}, theirs("ours", "sk_thief"))
    with pytest.raises(ConfigError, match=r"Ours of dlokit, and sk_thief:TheirConfig of thief"):
        kind().installed()


def test_settings_that_their_own_class_refuses_are_rejected_by_name(folder: Path) -> None:
    install(folder, "good-package", GROUP, {"near": "sk_strict:TheirConfig"}, theirs("near", "sk_strict"))
    with pytest.raises(SkillRejected, match="must not be negative") as rejected:
        kind().from_spec(StrategySpec(name="near", settings=b'{"radius_m": -1.0}'))
    assert rejected.value.reason == "bad_settings"


def test_a_name_that_nobody_has_is_answered_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match=r"--observer 'magic' is not known; choose one of ours\."):
        kind().named("magic", "--observer")
