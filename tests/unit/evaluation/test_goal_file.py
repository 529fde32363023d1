from dataclasses import replace
from pathlib import Path

import numpy as np
from made_results import made_action, made_run

from dlokit.description.shapes import builtin_shape
from dlokit.evaluation.judged_run import judged, judged_task
from dlokit.system.config import RunConfig
from dlokit.system.job import shape_from_text
from dlokit.system.results.run_result import RunRecord

GOAL = builtin_shape("W", 0.5, 31)
RECORD = RunRecord(
    name="I to W",
    result=made_run((made_action(1, "drag", grasp_ok=True, rmse_m=0.01),), rmse_m=0.01),
    goal_nodes_world=GOAL,
)


def test_the_goal_of_a_run_is_a_file_that_the_goal_option_takes(tmp_path: Path) -> None:
    judged(RunConfig(), RECORD, tmp_path, tmp_path)
    taken = shape_from_text(
        str(tmp_path / "goal.csv"), length_m=0.5, count=31, radius_m=0.004, rng=np.random.default_rng(0)
    )
    # Scaled from the chords of 31 nodes to the length of the rod.
    np.testing.assert_allclose(taken, GOAL, atol=1e-3)


def test_without_a_goal_there_is_no_goal_file(tmp_path: Path) -> None:
    judged(RunConfig(), replace(RECORD, goal_set=False), tmp_path, tmp_path)
    assert not (tmp_path / "goal.csv").exists()


def test_each_task_of_a_run_has_its_own_folder(tmp_path: Path) -> None:
    for number in (1, 2):
        record, out = judged_task(RunConfig(), RECORD, tmp_path, number)
        assert out == tmp_path / f"task-{number}"
        assert record.folder == tmp_path.name
        assert {file.name for file in out.iterdir()} == {"goal.csv", "result.json"}


def test_a_later_task_has_the_start_that_was_seen_in_a_file_that_the_start_option_takes(tmp_path: Path) -> None:
    seen = replace(RECORD, start_nodes_world=GOAL)
    outs = [judged_task(RunConfig(), seen, tmp_path, number)[1] for number in (1, 2)]
    assert [(out / "start.csv").exists() for out in outs] == [False, True]  # the configuration has that of the first
    taken = shape_from_text(
        str(outs[1] / "start.csv"), length_m=0.5, count=31, radius_m=0.004, rng=np.random.default_rng(0)
    )
    np.testing.assert_allclose(taken, GOAL, atol=1e-3)
