"""`python -m dlokit.testing observer NAME`: what it prints, and its exit codes."""

import pytest

from dlokit.errors import ConfigError
from dlokit.testing.__main__ import ObserverCheckArgs, run


def test_an_installed_observer_is_checked_by_its_name(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ObserverCheckArgs(observer="cpd")) == 0
    assert "cpd: 23 checks passed" in capsys.readouterr().out


def test_an_uninstalled_observer_is_checked_by_its_class(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ObserverCheckArgs(observer="broken_settings:Thawed")) == 1
    assert "Thawed is not frozen" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["crystal_ball", "no_module:C", "math:C"])
def test_a_missing_observer_is_bad_input(name: str) -> None:
    with pytest.raises(ConfigError, match=r"choose one of|module:Class"):
        run(ObserverCheckArgs(observer=name))
