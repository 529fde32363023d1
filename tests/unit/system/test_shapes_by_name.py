from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dlokit import geometry
from dlokit.description import shapes
from dlokit.description.clearance import clear_of
from dlokit.description.installation import PAPERS_CELL
from dlokit.description.scene import Post
from dlokit.errors import ShapeError
from dlokit.system.config import RunConfig
from dlokit.system.job import job_from_config, read_points, shape_from_text

RECORDED_GOALS = Path(__file__).resolve().parents[5] / "shared/data/goals/planar_goals.npy"
ON_TABLE = shapes.builtin_shape("S", 0.5, 60)


def _shape(text: str | Path, *, fit_length: bool = False, length_m: float = 0.5) -> np.ndarray:
    return shape_from_text(
        str(text),
        length_m=length_m,
        count=31,
        radius_m=0.004,
        rng=np.random.default_rng(3),
        fit_length=fit_length,
    )


def _npy(folder: Path, array: object, name: str = "goal.npy") -> Path:
    path = folder / name
    np.save(path, np.asarray(array))
    return path


def test_names_give_the_built_in_and_the_drawn_shapes() -> None:
    np.testing.assert_array_equal(_shape("S"), shapes.builtin_shape("S", 0.5, 31))
    np.testing.assert_array_equal(_shape("I"), shapes.builtin_shape("I", 0.5, 31))
    np.testing.assert_array_equal(_shape("random"), shapes.random_shape(np.random.default_rng(3), 0.5, 31))


def test_points_of_a_file_are_resampled_by_arc_length(tmp_path: Path) -> None:
    uneven = ON_TABLE[np.r_[0:30, 30:60:2, 59]]

    nodes = _shape(_npy(tmp_path, uneven))

    assert nodes.shape == (31, 3)
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    np.testing.assert_allclose(steps, steps.mean(), rtol=0.01)  # chords of a bent curve are up to 1 % shorter
    assert geometry.rmse_m(nodes, geometry.resample(ON_TABLE, 31)) < 1e-3  # dropped points cut corners by < 1 mm


def test_points_of_the_plane_get_the_height_of_the_rope(tmp_path: Path) -> None:
    nodes = _shape(_npy(tmp_path, ON_TABLE[:, :2]))

    assert np.all(nodes[:, 2] == pytest.approx(0.004))


def test_two_points_are_enough(tmp_path: Path) -> None:
    nodes = _shape(_npy(tmp_path, [[0.5, -0.25], [0.5, 0.25]]))

    np.testing.assert_allclose(nodes[:, 1], np.linspace(-0.25, 0.25, 31))


@pytest.mark.parametrize("separator", [",", ";", " ", ", "])
def test_csv_is_read_with_or_without_a_header(tmp_path: Path, separator: str) -> None:
    rows = [separator.join(f"{value:.9f}" for value in point) for point in ON_TABLE]
    plain, headed = tmp_path / "plain.csv", tmp_path / "headed.csv"
    plain.write_text("\n".join(rows) + "\n")
    headed.write_text(separator.join("xyz") + "\n# drawn by hand\n\n" + "\n".join(rows))

    np.testing.assert_allclose(read_points(str(plain)), ON_TABLE, atol=1e-9)
    np.testing.assert_array_equal(_shape(plain), _shape(headed))


def test_csv_of_a_spreadsheet_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    path = tmp_path / "goal.csv"
    path.write_text("0.5,-0.25\n0.5,0.25\n", encoding="utf-8-sig")

    np.testing.assert_array_equal(read_points(str(path)), [[0.5, -0.25], [0.5, 0.25]])


def test_one_of_several_shapes_is_taken_by_its_index(tmp_path: Path) -> None:
    several = _npy(tmp_path, np.stack([ON_TABLE, shapes.moved(ON_TABLE, (0.02, 0.0))]))

    shifted = shapes.moved(_shape(f"{several}:0"), (0.02, 0.0))
    np.testing.assert_allclose(_shape(f"{several}:1"), shifted, atol=1e-12)  # rounding


def test_a_different_length_is_an_error_unless_fitting_is_allowed(tmp_path: Path) -> None:
    path = _npy(tmp_path, shapes.fit_length(ON_TABLE, 0.47))

    with pytest.raises(ShapeError, match=r"0\.470 m long, the rope 0\.500 m; .*2%.*--fit-length"):
        _shape(path)
    # 31 chords along bends of 80 mm are 0.2 % shorter than the curve.
    assert shapes.length(_shape(path, fit_length=True)) == pytest.approx(0.5, rel=2e-3)


def test_a_length_within_the_tolerance_is_taken_and_made_the_ropes(tmp_path: Path) -> None:
    nodes = _shape(_npy(tmp_path, shapes.fit_length(ON_TABLE, 0.492)))

    assert shapes.length(nodes) == pytest.approx(0.5, rel=2e-3)  # chords, as above


BAD_ARRAYS = {
    "nan": (np.where(np.arange(60)[:, None] == 7, np.nan, ON_TABLE), r"NaN or infinity in 1 of 60.*point 7"),
    "infinity": (np.where(np.arange(60)[:, None] == 0, np.inf, ON_TABLE), "NaN or infinity"),
    "one point": (ON_TABLE[:1], r"1 point\(s\).*at least two"),
    "no point": (ON_TABLE[:0], r"0 point\(s\).*at least two"),
    "four columns": (np.ones((5, 4)), r"\(5, 4\).*\(K, 3\), \(K, 2\)"),
    "one row": (np.ones(3), r"\(3,\).*\(K, 3\)"),
    "four axes": (np.ones((2, 2, 2, 3)), r"\(2, 2, 2, 3\)"),
    "zero length": (np.full((4, 3), 0.1), "zero length"),
    "a pole": ([[0.5, 0.0, 0.0], [0.5, 0.0, 0.01]], "zero length in the table plane"),
    "millimetres": (ON_TABLE * 1000.0, "looks like millimetres.*divide them by 1000"),
    "off the table": (ON_TABLE + np.array([0.4, 0.0, 0.0]), r"outside the table.*allowed are x 0\.3 to 0\.75"),
    "in the air": (ON_TABLE + np.array([0.0, 0.0, 0.2]), "heights z.*table"),
    "text": (np.array([["a", "b"], ["c", "d"]]), "real numbers"),
    "complex": (ON_TABLE * 1j, "real numbers"),
    "several": (np.stack([ON_TABLE, ON_TABLE]), r"holds 2 shapes: name one, from .*:0 to .*:1"),
}


@pytest.mark.parametrize("case", BAD_ARRAYS)
def test_an_unusable_array_is_one_clear_error(tmp_path: Path, case: str) -> None:
    array, message = BAD_ARRAYS[case]

    with pytest.raises(ShapeError, match=message):
        _shape(_npy(tmp_path, array))


@pytest.mark.parametrize("index", ["2", "-1", "x", ""])
def test_an_invalid_index_is_refused_with_the_valid_ones(tmp_path: Path, index: str) -> None:
    path = _npy(tmp_path, np.stack([ON_TABLE, ON_TABLE]))

    with pytest.raises(ShapeError, match=r"allowed are .*:0 to .*:1"):
        _shape(f"{path}:{index}")


def test_an_index_into_a_single_shape_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ShapeError, match="single shape"):
        _shape(f"{_npy(tmp_path, ON_TABLE)}:0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Z", "no shape 'Z'. Allowed are I, L, U, S, W, spiral, random"),
        ("s", "did you mean 'S'"),
        ("Random", "did you mean 'random'"),
        ("", "no shape ''"),
        ("nowhere.npy", r"nowhere\.npy does not exist"),
        ("nowhere.npy:3", r"nowhere\.npy does not exist"),
    ],
)
def test_a_name_that_is_neither_shape_nor_file_is_one_clear_error(text: str, message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        _shape(text)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("goal.npy", b"", "is empty"),
        ("goal.csv", b"", "is empty"),
        ("goal.csv", b"0.4,0.1\na,b\n1,2\n", r"line 2: 'a,b'"),
        ("goal.csv", b"x,y\n", "contains no numbers"),
        ("goal.npy", b"not numpy", "is not an array"),
        ("goal.npy", b"\x93NUMPY\x01\x00", "is not an array"),
        ("goal.csv", b"0.4,0.1\n0.5,left\n", r"line 2: '0\.5,left'"),
        ("goal.csv", b"0.4,0.1\n0.5\n", "line 2 has 1 columns, the first has 2"),
        ("goal.csv", b"\xff\xfe\x00", "is not text"),
        ("goal.txt", b"0.4,0.1\n", r"ends in '\.txt'"),
    ],
)
def test_a_broken_file_is_one_clear_error(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)

    with pytest.raises(ShapeError, match=message):
        _shape(path)


def test_pickles_are_not_executed(tmp_path: Path) -> None:
    path = tmp_path / "goal.npy"
    np.save(path, np.array([{"a": 1}], dtype=object), allow_pickle=True)

    with pytest.raises(ShapeError, match="is not an array"):
        _shape(path)


@pytest.mark.skipif(not RECORDED_GOALS.exists(), reason="the recorded goals of another group are not here")
def test_recorded_goals_are_read_and_fitted_to_the_rope(tmp_path: Path) -> None:
    points = read_points(f"{RECORDED_GOALS}:3")
    placed = shapes.moved(points, np.array(shapes.CENTRE_M) - points[:, :2].mean(axis=0))

    nodes = _shape(_npy(tmp_path, placed), fit_length=True)

    assert points.shape == (10, 3)
    assert nodes.shape == (31, 3)
    with pytest.raises(ShapeError, match=r":0 to .*:49"):
        read_points(f"{RECORDED_GOALS}:50")


def test_a_goal_elsewhere_is_moved_by_its_centre(tmp_path: Path) -> None:
    about_origin = ON_TABLE - ON_TABLE.mean(axis=0)
    file = _npy(tmp_path, about_origin[:, :2])
    with pytest.raises(ShapeError, match=r"outside the table.*--goal-at-m"):
        _shape(file)

    nodes = shape_from_text(
        str(file), length_m=0.5, count=31, radius_m=0.004, rng=np.random.default_rng(3), middle_m=(0.5, 0.1)
    )

    middle = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
    np.testing.assert_allclose(middle, (0.5, 0.1), atol=1e-12)


def test_a_random_start_is_clear_of_the_true_fixtures_and_a_random_goal_of_the_known_ones() -> None:
    free = job_from_config(RunConfig(start="random", goal="random", seed=3))
    assert free.request is not None
    post = Post(name="A", position_m=(*free.start_nodes_world[50, :2].tolist(), 0.0))
    moved = Post(name="A", position_m=(*free.request.nodes_world[50, :2].tolist(), 0.0))
    for true, known in ((post, moved), (moved, post)):
        installation = replace(PAPERS_CELL, fixtures=(known,))
        config = RunConfig(start="random", goal="random", seed=3, installation=installation)
        job = job_from_config(replace(config, cell=replace(config.cell, fixtures=(true,))))
        assert job.request is not None
        for drawn, before, fixture in (
            (job.start_nodes_world, free.start_nodes_world, true),
            (job.request.nodes_world, free.request.nodes_world, known),
        ):
            assert clear_of(drawn, (fixture,), 0.004)
            assert np.array_equal(drawn, before) == clear_of(before, (fixture,), 0.004 + shapes.FIXTURE_CLEARANCE_M)
