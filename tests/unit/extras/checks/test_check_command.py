"""`python -m dlokit.testing observer NAME`: what it prints, and its exit codes; tests/contract has it check by name."""

from collections.abc import Callable

import pytest

from dlokit.errors import ConfigError
from dlokit.extras.checks.command import CheckArgs, ObserverCheckArgs, PlannerCheckArgs, SegmentationCheckArgs, run


def test_an_uninstalled_observer_is_checked_by_its_class(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(ObserverCheckArgs(observer="broken_settings:Thawed")) == 1
    assert "Thawed is not frozen" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["crystal_ball", "no_module:C", "math:C"])
@pytest.mark.parametrize(
    "args_of",
    [
        lambda name: ObserverCheckArgs(observer=name),
        lambda name: PlannerCheckArgs(planner=name),
        lambda name: SegmentationCheckArgs(segmentation=name),
    ],
)
def test_a_missing_strategy_is_bad_input(name: str, args_of: Callable[[str], CheckArgs]) -> None:
    with pytest.raises(ConfigError, match=r"choose one of|module:Class"):
        run(args_of(name))
