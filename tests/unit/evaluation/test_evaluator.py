import os
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import msgspec
import numpy as np
import pytest
from made_results import made_action, made_record, made_run

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.passing import passing
from dlokit.description.scene import Fixture, Post
from dlokit.errors import InputError
from dlokit.evaluation.evaluator import (
    SETTLE_S,
    Truth,
    evaluate,
    left_nodes_world,
    read_truth,
    true_errors,
    with_forces,
    with_true_passing,
    with_truth,
)
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.truth import FORCES_FILE, NO_FORCES, ROWS_FILE, TRUTH_FILE, TruthRecorder
from dlokit.functional.cell.world import Cell
from dlokit.recording.disk import Disk
from dlokit.system.results.run_result import FixtureContact, RunRecord
from dlokit.types.passing import AsWished, SideWish

S = 1_000_000_000
GOAL = shapes.builtin_shape("S", 0.5, 31)
CELL_GOAL = shapes.builtin_shape("S", 0.5, 41)
START = shapes.builtin_shape("I", 0.5, 41)
# Resampling 41 nodes to 31 cuts corners of 80 mm bends by (12.5 mm)² / (8 · 80 mm) = 0.24 mm, twice over.
RESAMPLING_M = 5e-4


def _truth(*keyframes: tuple[float, np.ndarray]) -> Truth:
    return Truth(
        stamps_ns=np.array([round(t * S) for t, _ in keyframes], dtype=np.int64),
        nodes_world=np.stack([nodes for _, nodes in keyframes]),
    )


def _errors(truth: Truth, releases: list[int | None], *, first: np.ndarray | None = None, ends: bool = False):
    return true_errors(
        truth,
        goal_nodes_world=GOAL,
        first_nodes_world=shapes.builtin_shape("I", 0.5, 31) if first is None else first,
        first_stamp_ns=0,
        release_stamps_ns=releases,
        ends_interchangeable=ends,
    )


def test_each_release_is_evaluated_two_seconds_later_at_the_nodes_of_the_goal() -> None:
    off = shapes.moved(CELL_GOAL, (0.03, 0.0))
    truth = _truth((0, START), (9, START), (10, off), (15, off), (16, CELL_GOAL), (20, CELL_GOAL))

    errors = _errors(truth, [10 * S, 16 * S])

    assert errors.after_action_m == pytest.approx((0.03, 0.0), abs=RESAMPLING_M)
    assert errors.final_m == errors.after_action_m[-1]
    assert errors.final_largest_m == pytest.approx(0.0, abs=2 * RESAMPLING_M)
    assert not errors.reversed_order


def test_the_time_after_the_release_is_the_settling_time() -> None:
    still_moving = _truth((0, START), (10, START), (10 + SETTLE_S, CELL_GOAL), (20, START))

    assert _errors(still_moving, [10 * S]).final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_the_largest_error_is_that_of_the_node_farthest_from_its_goal() -> None:
    bent = CELL_GOAL.copy()
    bent[0, 1] += 0.05

    errors = _errors(_truth((0, START), (10, bent), (14, bent)), [10 * S])

    assert errors.final_largest_m == pytest.approx(0.05, abs=RESAMPLING_M)
    assert errors.final_m is not None
    assert errors.final_m < 0.03  # the others are nearer


def test_between_two_records_the_truth_is_interpolated() -> None:
    truth = _truth((0, START), (10, CELL_GOAL), (14, shapes.moved(CELL_GOAL, (0.04, 0.0))))

    assert _errors(truth, [10 * S]).final_m == pytest.approx(0.02, abs=RESAMPLING_M)


def test_a_system_that_counts_from_the_other_end_is_evaluated_in_its_own_order() -> None:
    truth = _truth((0, START[::-1]), (10, CELL_GOAL[::-1]), (14, CELL_GOAL[::-1]))

    errors = _errors(truth, [10 * S])

    assert errors.reversed_order
    assert errors.final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_the_order_of_the_first_observation_is_kept_for_the_whole_run() -> None:
    truth = _truth((0, START), (10, CELL_GOAL[::-1]), (14, CELL_GOAL[::-1]))

    wrong_way_round, either_way = _errors(truth, [10 * S]), _errors(truth, [10 * S], ends=True)

    assert not wrong_way_round.reversed_order
    assert wrong_way_round.final_m is not None
    assert wrong_way_round.final_m > 0.1  # the ends are 0.33 m apart
    assert either_way.final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_an_action_without_a_release_has_no_true_error_and_the_last_release_counts() -> None:
    truth = _truth((0, START), (10, CELL_GOAL), (30, CELL_GOAL))

    errors = _errors(truth, [10 * S, None])

    assert errors.after_action_m[1] is None
    assert errors.final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_a_release_that_the_truth_does_not_cover_has_no_true_error() -> None:
    truth = _truth((0, START), (11.5, CELL_GOAL))

    errors = _errors(truth, [10 * S])

    assert errors.after_action_m == (None,)
    assert errors.final_m is None


def test_without_any_release_the_end_of_the_record_counts() -> None:
    assert _errors(_truth((0, START), (5, CELL_GOAL)), []).final_m == pytest.approx(0.0, abs=RESAMPLING_M)
    assert _errors(_truth((0, CELL_GOAL)), []).final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_truth_that_begins_after_the_run_is_refused() -> None:
    with pytest.raises(InputError, match="not of the same run"):
        _errors(_truth((1, START), (5, CELL_GOAL)), [])


def _record(start: np.ndarray | None, releases: list[int]) -> RunRecord:
    rows = tuple(made_action(number) for number in range(1, len(releases) + 1))
    result = made_run(rows)
    return RunRecord(
        name="I to S",
        result=result,
        goal_nodes_world=GOAL,
        start_nodes_world=start,
        actions=tuple(made_record(GOAL, release_stamp_ns=stamp) for stamp in releases),
    )


def test_the_true_errors_are_added_to_the_result() -> None:
    truth = _truth((0, START), (10, CELL_GOAL), (14, CELL_GOAL))
    record = _record(shapes.builtin_shape("I", 0.5, 31), [10 * S])

    result = with_truth(record.result, evaluate(record, truth))

    assert result.true_rmse_m == pytest.approx(0.0, abs=RESAMPLING_M)
    assert result.history[0].true_rmse_m == result.true_rmse_m
    assert result.rmse_m == 0.01


def test_true_errors_of_another_run_are_not_added() -> None:
    truth = _truth((0, START), (14, CELL_GOAL))
    record = _record(shapes.builtin_shape("I", 0.5, 31), [10 * S])
    without_history = msgspec.structs.replace(record.result, history=())

    with pytest.raises(InputError, match="not of the same run"):
        with_truth(without_history, evaluate(record, truth))


def test_how_the_true_dlo_passes_the_true_posts_is_added_to_the_result() -> None:
    node = CELL_GOAL[20]
    left = Post(name="A", position_m=(float(node[0]) + 0.02, float(node[1]), 0.0))
    right = replace(left, position_m=(float(node[0]) - 0.02, float(node[1]), 0.0))
    record = _record(shapes.builtin_shape("I", 0.5, 31), [10 * S])
    wish = (SideWish(name="A", turn=1),)
    result = msgspec.structs.replace(record.result, passing=passing(GOAL, (left,), wish))

    for cells, reverse in ((CELL_GOAL, False), (CELL_GOAL[::-1], True)):
        # The cell counts from the other end in the second case; the answer is for the system's order.
        start = START[::-1] if reverse else START
        errors = evaluate(record, _truth((0, start), (10, cells), (14, cells)))
        for posts, answers in (((left,), [AsWished.YES]), ((right,), [AsWished.NO]), ((), [])):
            true = with_true_passing(result, errors, posts, ends_interchangeable=False).true_passing
            assert true is not None
            assert [one.answer for one in true.answers] == answers

    uncovered = evaluate(record, _truth((0, START), (10, CELL_GOAL)))
    assert with_true_passing(result, uncovered, (left,), ends_interchangeable=False).true_passing is None
    assert with_true_passing(record.result, errors, (), ends_interchangeable=False).true_passing is None


def test_a_rope_that_was_never_seen_still_has_a_true_error() -> None:
    assert evaluate(_record(None, []), _truth((0, CELL_GOAL[::-1]))).final_m == pytest.approx(0.0, abs=RESAMPLING_M)


def test_truth_is_read_from_the_runs_folder(tmp_path: Path) -> None:
    truth = _truth((0, START), (1, CELL_GOAL))
    np.savez(tmp_path / "truth.npz", stamps_ns=truth.stamps_ns, nodes_world=truth.nodes_world)

    read = read_truth(tmp_path)

    np.testing.assert_array_equal(read.stamps_ns, truth.stamps_ns)
    np.testing.assert_array_equal(read.nodes_world, truth.nodes_world)


def test_what_the_cell_records_is_what_the_evaluator_reads(tmp_path: Path) -> None:
    cell = Cell(CellConfig(), seed=0)
    recorder = TruthRecorder(tmp_path)
    cell.place_dlo(CELL_GOAL)
    for _ in range(3):
        recorder.note(cell)
        cell.step(0.1)
    recorder.write()

    truth = read_truth(tmp_path)

    np.testing.assert_array_equal(truth.stamps_ns, [0, S // 10, S // 5])
    assert truth.nodes_world.shape == (3, 41, 3)
    assert geometry.rmse_m(truth.at(0), CELL_GOAL) < 1e-3  # spring-back of an S until it rests
    cell.close()


def test_the_truth_of_a_killed_cell_is_read_up_to_its_last_whole_note(tmp_path: Path) -> None:
    disk = Disk()
    cell, recorder = Cell(CellConfig(), seed=0), TruthRecorder(tmp_path, disk)
    for _ in range(15):
        recorder.note(cell)
        cell.step(0.1)
    assert disk.settle()
    rows = tmp_path / ROWS_FILE
    rows.write_bytes(rows.read_bytes()[:-10])

    truth = read_truth(tmp_path)

    assert truth.stamps_ns.tolist() == [number * S // 10 for number in range(10)]
    assert truth.nodes_world.shape == (10, 41, 3)
    np.testing.assert_array_equal(left_nodes_world(tmp_path), truth.nodes_world[-1])
    cell.close()


def _recorded(folder: Path, *fixtures: Fixture, disk: Disk) -> tuple[Cell, TruthRecorder]:
    cell, recorder = Cell(CellConfig(fixtures=fixtures), seed=0), TruthRecorder(folder, disk)
    for _ in range(15):
        recorder.note(cell)
        cell.step(0.1)
    assert disk.settle()
    return cell, recorder


def test_the_forces_on_fixtures_are_in_the_truth_of_ended_and_killed_cells(tmp_path: Path) -> None:
    # The hand is in it from the beginning.
    struck, aside = (
        Post(name="struck", position_m=(0.28, 0.08, 0.0), height_m=0.6),
        Post(name="aside", position_m=(0.6, 0.3, 0.0)),
    )
    cell, recorder = _recorded(tmp_path, struck, aside, disk=Disk())
    assert cell.fixture_forces is not None
    assert set(cell.fixture_forces["fixture"]) == {"struck"}
    assert (tmp_path / FORCES_FILE).exists()

    killed = read_truth(tmp_path).fixture_forces
    recorder.write()
    ended = read_truth(tmp_path).fixture_forces

    np.testing.assert_array_equal(killed, cell.fixture_forces)
    np.testing.assert_array_equal(ended, cell.fixture_forces)
    assert sorted(path.name for path in tmp_path.iterdir()) == [TRUTH_FILE]
    cell.close()


def test_the_truth_has_forces_where_there_are_fixtures_only(tmp_path: Path) -> None:
    for name, fixtures in (("bare", ()), ("furnished", (Post(name="aside", position_m=(0.6, 0.3, 0.0)),))):
        cell, recorder = _recorded(tmp_path / name, *fixtures, disk=Disk())
        killed = read_truth(tmp_path / name).fixture_forces
        recorder.write()
        ended = read_truth(tmp_path / name).fixture_forces
        for forces in (killed, ended):
            assert (forces is None) == (not fixtures)
            assert forces is None or len(forces) == 0
        cell.close()


def test_the_result_has_the_largest_force_and_where_it_acted() -> None:
    truth, result = _truth((0, START), (1, START)), made_run(())
    rows = [("first/hand", "A", 3.0, 7), ("first/left_finger", "B", 12.5, 8 * S), ("second/link6", "A", 4.0, 9)]
    for forces, largest_n, contact in (
        (None, None, None),
        (NO_FORCES, 0.0, None),
        (
            np.array(rows, NO_FORCES.dtype),
            12.5,
            FixtureContact(link="first/left_finger", fixture="B", stamp_ns=8 * S),
        ),
    ):
        judged = with_forces(result, replace(truth, fixture_forces=forces))
        assert (judged.largest_fixture_force_n, judged.fixture_contact) == (largest_n, contact)


def test_a_disk_that_was_full_for_a_while_loses_no_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk()
    cell, recorder = Cell(CellConfig(), seed=0), TruthRecorder(tmp_path, disk)

    def go_on(notes: int) -> None:
        for _ in range(notes):
            recorder.note(cell)
            cell.step(0.1)
        disk.settle()

    go_on(12)
    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", _torn)
        go_on(12)
        assert disk.failures == {TRUTH_FILE: "No space left on device"}
    go_on(12)
    recorder.write()

    assert disk.failures == {}
    assert read_truth(tmp_path).stamps_ns.tolist() == [number * S // 10 for number in range(36)]
    assert not (tmp_path / ROWS_FILE).exists()
    cell.close()


def _torn(path: Path, *_: object, **__: object) -> NoReturn:
    """Leave a part of a row, as a disk that becomes full within a write does."""
    handle = os.open(path, os.O_WRONLY | os.O_APPEND)
    os.write(handle, b"part of a row")
    os.close(handle)
    raise OSError(28, "No space left on device")


def test_missing_or_foreign_truth_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="only runs on the simulated cell"):
        read_truth(tmp_path)
    (tmp_path / "truth.npz").write_bytes(b"no zip")
    with pytest.raises(InputError, match="not a cell's truth"):
        read_truth(tmp_path)
    np.savez(tmp_path / "truth.npz", stamps_ns=np.arange(3))
    with pytest.raises(InputError, match="not a cell's truth"):
        read_truth(tmp_path)
    np.savez(tmp_path / "truth.npz", stamps_ns=np.arange(3), nodes_world=np.zeros((2, 41, 3)))
    with pytest.raises(InputError, match=r"expected \(T,\) and \(T, Mc, 3\)"):
        read_truth(tmp_path)
