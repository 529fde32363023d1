"""The requirements of `dlokit.testing` on every observer, dlokit's and installed ones."""

import pytest

from dlokit.extras.checks.command import ObserverCheckArgs, run
from dlokit.skills.observer.base import ObserverStrategyConfig
from dlokit.skills.observer.config import OURS, from_spec, strategies, to_spec

OBSERVERS = list(strategies().values())

every_observer = pytest.mark.parametrize("config", OBSERVERS, ids=[config.name for config in OBSERVERS])


@every_observer
def test_an_observer_conforms_to_the_protocol_and_built_in_ones_track_branched_dlos(
    config: type[ObserverStrategyConfig], capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(ObserverCheckArgs(observer=config.name))
    said = capsys.readouterr().out
    assert code == 0, said
    assert f"{config.name}: 24 checks passed" in said
    assert config not in OURS or "follows branched DLOs" in said


@every_observer
def test_its_settings_survive_encoding(config: type[ObserverStrategyConfig]) -> None:
    assert from_spec(to_spec(config())) == config()
