from pathlib import Path

import msgspec

from dlokit.evaluation.judged_run import drawn
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.system.config import RunConfig
from dlokit.system.results.run_result import RunResult, read_result, write_result
from dlokit.types.flow import RunOutcome


def test_a_result_tells_what_the_cell_of_its_seed_drew(tmp_path: Path) -> None:
    config = RunConfig(seed=7, cell=CellConfig(randomised=EVERY_FACTOR))
    episode = drawn(config)
    assert episode is not None
    result = RunResult(
        outcome=RunOutcome.STALLED,
        actions=0,
        rmse_m=None,
        threshold_m=0.012,
        seed=7,
        sim_time_s=0.0,
        wall_time_s=0.0,
        planning_time_s=0.0,
        config_hash="",
        version="",
    )
    write_result(tmp_path, msgspec.structs.replace(result, episode=episode))
    assert read_result(tmp_path).episode == episode
    cell = Cell(config.cell, seed=config.seed)
    assert cell.episode == episode
    assert cell.config.camera_error_m == episode.hand_eye_m


def test_a_result_tells_of_no_draw_where_nothing_is_randomised() -> None:
    assert drawn(RunConfig(seed=7)) is None
