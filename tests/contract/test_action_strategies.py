"""Requirements on every action strategy that ships with dlokit; a new one is a row in `strategies.OURS`."""

import pytest

from dlokit.errors import SkillRejected
from dlokit.extras.checks.command import PlannerCheckArgs, run
from dlokit.skills.planning.base import StrategyConfig
from dlokit.skills.planning.config import OURS, from_spec, to_spec
from dlokit.skills.planning.rollout.search import SearchConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.testing import check_planner
from dlokit.types.system import StrategySpec

SHORT = RolloutConfig(search=SearchConfig(rollouts=40, finalists=2, generations=1))
"""Properties of every action can be checked after a short search."""

pytestmark = pytest.mark.parametrize("config", OURS, ids=lambda config: config.name)


def test_it_keeps_to_its_protocol(config: type[StrategyConfig], capsys: pytest.CaptureFixture[str]) -> None:
    if config is RolloutConfig:
        assert check_planner(SHORT).passed
    else:
        assert run(PlannerCheckArgs(planner=config.name)) == 0
        assert f"{config.name}: 14 checks passed" in capsys.readouterr().out


def test_its_settings_survive_encoding(config: type[StrategyConfig]) -> None:
    assert from_spec(to_spec(config())) == config()
    assert from_spec(StrategySpec(name=config.name)) == config()


def test_an_unknown_setting_is_rejected_by_name(config: type[StrategyConfig]) -> None:
    with pytest.raises(SkillRejected, match=r"no setting.*colour") as rejected:
        from_spec(StrategySpec(name=config.name, settings=b'{"colour": 1}'))
    assert rejected.value.reason == "bad_settings"
