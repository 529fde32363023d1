"""A setting of an earlier name is read from files, and refused with its present name where a person writes it."""

import pytest

import dlokit
from dlokit.app.commands import execute
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.configuration.renamed import RENAMED
from dlokit.system.configuration.toml_config import from_toml, to_plain
from dlokit.system.request import with_settings
from dlokit.system.results.run_result import ActionResult


def test_a_file_of_an_earlier_run_is_read_under_the_present_names() -> None:
    text = "[task]\nhopeless_actions = 5\n[planning.feasibility]\nhold_share = 0.25\n"
    run = from_toml(text + '[observer.strategy]\nkind = "som"\nmisfit_share = 0.9\n', RunConfig, "config.toml")
    assert run.task.no_progress_actions == 5
    assert run.planning.feasibility.hold_fraction == 0.25
    assert to_plain(run.observer.strategy)["misfit_fraction"] == 0.9


def test_a_file_with_both_names_of_a_setting_is_refused() -> None:
    with pytest.raises(ConfigError, match="hopeless_actions"):
        from_toml("[task]\nhopeless_actions = 5\nno_progress_actions = 3\n", RunConfig, "config.toml")


@pytest.mark.parametrize(("earlier", "present"), RENAMED.items())
def test_a_setting_of_the_library_by_an_earlier_name_is_refused(earlier: str, present: str) -> None:
    with pytest.raises(ConfigError, match=f"{earlier} is called {present} now"):
        with_settings(RunConfig(), {earlier: 1})


@pytest.mark.parametrize("words", [("--task.hopeless-actions", "5"), ("--task.hopeless_actions=5",)])
def test_an_option_of_an_earlier_name_is_refused(words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError, match=r"is called --task\.no-progress-actions now"):
        execute(["shape", "--headless", *words])


def test_a_field_of_an_earlier_name_is_refused_with_the_present_one() -> None:
    nodes = object.__new__(dlokit.Nodes)
    with pytest.raises(AttributeError, match=r"Nodes\.distrust"):
        _ = nodes.doubt
    row = ActionResult(
        action=1,
        kind="drag",
        grasp_node=3,
        grasp_ok=True,
        rmse_m=0.01,
        duration_s=1.0,
        robot_time_s=1.0,
        path_length_m=0.1,
        planning_time_s=0.1,
    )
    with pytest.raises(AttributeError, match="prediction_error_m"):
        _ = row.missed_m
