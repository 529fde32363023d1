import asyncio
import io
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from made_results import made_action, made_run
from rich.console import Console

from dlokit.app.shape.shape import display_of, stays
from dlokit.app.shape.terminal import RunDisplay
from dlokit.description import shapes
from dlokit.errors import ConfigError
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_result import RunRecord

LIVE = RunConfig(runtime="live")


@pytest.mark.parametrize(
    ("config", "asked", "expected"),
    [
        (LIVE, False, False),
        (LIVE, True, True),
        (replace(LIVE, goal="interactive"), False, True),
        (replace(LIVE, goal="seen"), False, True),
        (replace(LIVE, goal="interactive", dry_run=True), False, False),
        (RunConfig(), False, False),
    ],
)
def test_a_run_stays_where_its_operator_sets_the_goals_or_where_it_is_asked_to(
    config: RunConfig, asked: bool, expected: bool
) -> None:
    assert stays(config, asked=asked) is expected


@pytest.mark.parametrize("config", [RunConfig(), replace(LIVE, headless=True), replace(LIVE, dry_run=True)])
def test_a_run_without_a_page_cannot_be_asked_to_stay(config: RunConfig) -> None:
    with pytest.raises(ConfigError, match="--runtime live"):
        stays(config, asked=True)


@pytest.mark.parametrize("goal", ["interactive", "seen"])
def test_a_goal_of_the_operator_needs_the_viewer(goal: str) -> None:
    with pytest.raises(ConfigError, match="needs the viewer"):
        RunConfig(goal=goal, headless=True)


def test_the_report_of_a_later_task_repeats_it_from_the_start_that_was_seen(tmp_path: Path) -> None:
    result = msgspec.structs.replace(made_run(()), goal="S", task=2)
    seen, goal = shapes.builtin_shape("L", 0.5, 31), shapes.builtin_shape("S", 0.5, 31)
    record = RunRecord(name="I to interactive", result=result, goal_nodes_world=goal, start_nodes_world=seen)
    job = ShapeJob(name="I to interactive", start_nodes_world=seen, request=None, stays=True)
    display = display_of(LIVE, job, tmp_path, Console(file=io.StringIO(), width=100))

    asyncio.run(display.ended(2, record))
    page = (tmp_path / "task-2" / "report.html").read_text(encoding="utf-8")
    files = f"--start {tmp_path}/task-2/start.csv --goal {tmp_path}/task-2/goal.csv --fit-length"
    assert f"dlokit shape --config {tmp_path}/config.toml {files}</pre>" in page

    asyncio.run(display.ended(3, replace(record, start_nodes_world=None, goal_set=False)))
    page = (tmp_path / "task-3" / "report.html").read_text(encoding="utf-8")
    assert f"dlokit shape --config {tmp_path}/config.toml</pre>" in page


def test_the_end_of_a_task_is_printed_with_the_truth_which_the_page_does_not_get(tmp_path: Path) -> None:
    made = made_run((made_action(1, "drag", grasp_ok=True, rmse_m=0.0101),), rmse_m=0.0101)
    result = msgspec.structs.replace(made, goal="curve.csv")
    record = RunRecord(name="I to S", result=result, goal_nodes_world=np.zeros((2, 3)))
    folder = tmp_path / "task-3"
    folder.mkdir()
    (folder / "report.html").touch()
    (folder / "goal.csv").touch()

    def keep(number: int, kept: RunRecord) -> tuple[RunRecord, Path]:
        return replace(kept, result=msgspec.structs.replace(result, true_rmse_m=0.0321)), folder

    console = Console(file=io.StringIO(), width=100)
    display = RunDisplay(console, title="I to S", threshold_m=0.012, keep=keep)
    end = asyncio.run(display.ended(3, record))
    assert isinstance(console.file, io.StringIO)
    written = console.file.getvalue()
    assert "task 3: to curve.csv" in written
    assert "32.1 mm" in written
    assert "next goal" in written
    assert (end.number, end.goal, end.files) == (3, "curve.csv", ("task-3/report.html", "task-3/goal.csv"))
    assert end.folder == str(tmp_path)
    assert "32.1" not in end.text
