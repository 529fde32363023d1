import io
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from made_results import made_run
from rich.console import Console

from dlokit.app.shape import shape
from dlokit.app.shape.shape import exit_code
from dlokit.description import shapes
from dlokit.description.installation import PAPERS_CELL
from dlokit.description.scene import Post
from dlokit.errors import EXIT_FAULT, MachineError
from dlokit.evaluation.judged_run import drawn, judged_run
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.system.config import RunConfig
from dlokit.system.job import ShapeJob
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.results.run_result import RunRecord, RunResult, read_result, write_result
from dlokit.system.shaping import Watcher
from dlokit.types.flow import RunOutcome

RECORD = RunRecord(name="I to S", result=made_run(()), goal_nodes_world=shapes.builtin_shape("S", 0.5, 31))


def test_a_result_has_the_random_factors_of_its_cell(tmp_path: Path) -> None:
    posts = replace(PAPERS_CELL, fixtures=(Post(name="A", position_m=(0.6, 0.2, 0.0)),))
    config = RunConfig(seed=7, cell=CellConfig(randomised=EVERY_FACTOR), installation=posts)
    episode = drawn(config)
    assert episode is not None
    assert [fixture.name for fixture in episode.fixtures] == ["A"]
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
    cell = Cell(config.cell, seed=config.seed, installation=posts)
    assert cell.drawn == episode
    assert cell.config.camera_error_m == episode.hand_eye_m


def test_a_result_has_no_random_factors_without_randomisation() -> None:
    assert drawn(RunConfig(seed=7)) is None


def test_files_that_the_disk_refuses_are_named_in_the_record_and_the_others_are_kept(tmp_path: Path) -> None:
    (tmp_path / "result.json.part").mkdir()  # in its place no file can be opened
    config, ended = RunConfig(), replace(RECORD, unwritten={"journal.msgpack": "No space left on device"})
    job = ShapeJob(name="I to S", start_nodes_world=HIDDEN_START, request=None)

    record = judged_run(config, job, tmp_path, Watcher(), lambda *_: ended)

    assert record.result.outcome is ended.result.outcome
    assert record.unwritten["journal.msgpack"] == "No space left on device"
    assert record.unwritten["result.json"] == "Is a directory"
    assert "holds no truth.npz" in record.unwritten["truth.npz"]
    assert (tmp_path / "config.toml").exists()
    assert exit_code(record) == EXIT_FAULT


def test_a_folder_that_was_deleted_during_the_run_gets_its_result(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    job = ShapeJob(name="I to S", start_nodes_world=HIDDEN_START, request=None)

    def runner(*_: object) -> RunRecord:
        shutil.rmtree(folder)
        return RECORD

    record = judged_run(RunConfig(), job, folder, Watcher(), runner)

    assert list(record.unwritten) == ["truth.npz"]
    assert read_result(folder).outcome is record.result.outcome
    assert (folder / "config.toml").exists()


def test_a_run_does_not_start_in_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "config.toml.part").mkdir()
    job = ShapeJob(name="I to S", start_nodes_world=HIDDEN_START, request=None)
    with pytest.raises(MachineError, match=r"config.toml cannot be written .* free space on the disk"):
        judged_run(RunConfig(), job, tmp_path, Watcher())


def test_a_run_whose_files_are_missing_says_so_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "report.html.part").mkdir()
    (tmp_path / "result.json").touch()
    ended = replace(RECORD, unwritten={"recording.mcap": "No space left on device"})
    console = Console(file=io.StringIO(), width=100)
    job = ShapeJob(name="I to S", start_nodes_world=HIDDEN_START, request=None)
    display = shape.display_of(RunConfig(), job, tmp_path, console)

    record = shape.reported(ended, job, tmp_path, display, "dlokit shape --config x")

    assert isinstance(console.file, io.StringIO)
    printed = console.file.getvalue()
    assert ended.result.outcome.value in printed
    assert printed.splitlines()[-1] == (
        "The run has ended, but files are missing or incomplete: recording.mcap (No space left on device); report.html "
        f"(Is a directory); kept in {tmp_path}: result.json; check that disk, then repeat the run: "
        "dlokit shape --config x"
    )
    assert exit_code(record) == EXIT_FAULT
