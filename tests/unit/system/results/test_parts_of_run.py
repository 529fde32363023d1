"""What a report says of the parts of a run and its changed settings."""

from dataclasses import replace

from made_fixtures import FURNISHED

from dlokit.description.installation import Installation
from dlokit.functional.cameras.simulated import SimulatedD435Config
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.system.config import RunConfig
from dlokit.system.results.parts_of_run import changed_settings, parts_of_run, setting_text


def test_a_run_with_defaults_has_no_changed_settings() -> None:
    assert changed_settings(RunConfig()) == {}


def test_start_goal_and_seed_are_settings_like_all_others() -> None:
    changed = changed_settings(replace(RunConfig(), start="S", goal="I", seed=7))
    assert changed == {"start": "S", "goal": "I", "seed": "7"}


def test_a_fixture_is_a_setting_with_all_its_values() -> None:
    config = replace(RunConfig(), installation=Installation(fixtures=FURNISHED.fixtures))
    text = changed_settings(config)["installation.fixtures"]
    for fixture in FURNISHED.fixtures:
        assert f"name {fixture.name}" in text


def test_a_setting_is_read_by_its_path_and_a_strategy_by_its_name() -> None:
    config = RunConfig()
    assert setting_text(config, "task.threshold_m") == "0.012"
    assert setting_text(config, "observer.strategy") == "map"
    assert setting_text(config, "observer.strategy.nothing") is None
    assert setting_text(config, "seed.of") is None


def test_a_changed_setting_is_named_by_its_path_with_its_value() -> None:
    config = RunConfig()
    config = replace(config, headless=True, task=replace(config.task, threshold_m=0.02))
    assert changed_settings(config) == {"headless": "yes", "task.threshold_m": "0.02"}


def test_another_strategy_is_named_and_only_what_differs_from_its_own_defaults() -> None:
    usual = CpdConfig()
    changed = replace(usual, max_points=usual.max_points + 1)
    observer = replace(RunConfig().observer, strategy=changed)
    assert changed_settings(replace(RunConfig(), observer=observer)) == {
        "observer.strategy": "cpd",
        "observer.strategy.max_points": str(usual.max_points + 1),
    }


def test_the_parts_name_arm_camera_dlo_planner_observer_and_fixtures() -> None:
    config = replace(RunConfig(), camera=SimulatedD435Config(), installation=Installation(fixtures=FURNISHED.fixtures))
    parts = parts_of_run(config)
    assert parts["arm"].startswith("Franka Emika Panda")
    assert (parts["camera"], parts["planner"], parts["observer"]) == ("simulated-d435", "rollout", "map")
    assert parts["DLO"] == "soft rope, 0.5 m long, 8 mm thick"
    assert parts["fixtures"] == ", ".join(fixture.name for fixture in FURNISHED.fixtures)
    assert "fixtures" not in parts_of_run(RunConfig())
