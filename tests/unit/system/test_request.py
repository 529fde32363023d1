"""Arguments of the library as parts of a configuration."""

from pathlib import Path

import numpy as np
import pytest

from dlokit.errors import ConfigError, InputError
from dlokit.skills.observer.base import nothing_seen
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.skills.planning.rollout.strategy import RolloutConfig
from dlokit.system.job import named_or_saved
from dlokit.system.request import Choices, RunRequest, apart
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


def test_points_that_are_no_numbers_are_refused_by_the_arguments_name(tmp_path: Path) -> None:
    for points in ([["0.1", "a"]], [[0.1, 0.2], [0.3]], np.ones((3, 2)) * 1j):
        with pytest.raises(InputError, match="goal"):
            named_or_saved(points, "goal", tmp_path)


def test_masked_points_are_saved_as_gaps_which_shapes_may_not_have(tmp_path: Path) -> None:
    masked = np.ma.masked_array([[0.1, 0.2], [9.0, 9.0]], mask=[[False, False], [True, True]])
    np.testing.assert_array_equal(np.load(named_or_saved(masked, "goal", tmp_path)), [[0.1, 0.2], [np.nan, np.nan]])


class Blind:
    """An observer of the calling program."""

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        return nothing_seen(seen, prior)


def test_a_choice_may_be_the_settings_of_an_installed_strategy() -> None:
    run = RunRequest(choices=Choices(observer=CpdConfig(), planner=RolloutConfig())).configured()
    assert (run.observer.strategy, run.planning.strategy) == (CpdConfig(), RolloutConfig())


def test_an_object_of_the_caller_is_refused_where_it_is_not_registered() -> None:
    choices = Choices(observer=Blind())
    wanted = (
        "^observer is an object of type Blind; give the name or the settings of an installed observer.*dlokit.shape"
    )
    with pytest.raises(ConfigError, match=wanted):
        RunRequest(choices=choices).configured()
    named, own = apart(choices)
    with own.known():
        assert RunRequest(choices=named).configured().observer.strategy.name == "Blind"


def test_settings_of_an_installed_strategy_are_no_object_of_the_caller() -> None:
    choices = Choices(planner=RolloutConfig(), observer=Blind())
    named, own = apart(choices)
    assert named == Choices(planner=RolloutConfig(), observer="Blind")
    assert (own.planners, own.observers) == ({}, {"Blind": choices.get("observer")})


def test_the_class_of_settings_in_place_of_settings_is_refused() -> None:
    with pytest.raises(ConfigError, match="--planner is an object of type type;"):
        RunRequest(choices=Choices(planner=RolloutConfig), prefix="--").configured()  # pyright: ignore[reportArgumentType]
