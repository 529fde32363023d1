"""LeRobot iterates the data sets that `dlokit export --to lerobot` writes: `make test-peers`."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as parquet
import pytest
from lerobot_peer import VIEW, read_by_lerobot, why_not
from videos import apart, read_video

from dlokit.app.commands import execute

pytestmark = [pytest.mark.peers, pytest.mark.skipif(bool(why_not()), reason=why_not() or "it can run")]

PICTURE = 2.5
"""Mean difference of a picture by two decoders, whose conversions of colours differ [grey levels of 255]."""


def test_lerobot_reads_every_frame_of_every_episode_with_its_picture(simulated_run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    assert (
        execute(["shape", "--headless", "--start", "random", "--goal", "I", "--seed", "1001", "--out", str(other)]) == 0
    )
    out = tmp_path / "set"
    runs = [str(simulated_run), str(other)]
    assert execute(["export", *runs, "--to", "lerobot", "--width-px", "160", "--out", str(out)]) == 0

    read = read_by_lerobot(out, tmp_path)

    table = parquet.read_table(out / "data/chunk-000/file-000.parquet")
    for name in table.column_names:
        np.testing.assert_array_equal(read[name], np.array(table[name].to_pylist(), dtype=read[name].dtype))
    assert set(read["task"]) == {f"bring the soft rope into the shape {goal}" for goal in "SI"}
    assert np.flatnonzero(read["next.done"]).tolist() == np.flatnonzero(read["next.success"]).tolist()
    assert read["episodes"] == 2
    assert read["frames_of_last"] == np.count_nonzero(read["episode_index"] == 1)
    assert read["task_of_last"] == "bring the soft rope into the shape I"
    np.testing.assert_allclose(read["state_mean"], read["observation.state"].mean(axis=0), atol=1e-4)
    np.testing.assert_array_equal(read["two_actions"], read["action"][5:7])
    np.testing.assert_array_equal(read["two_pictures"], read[VIEW][4:6])
    shown = read_video(out / f"videos/{VIEW}/chunk-000/file-000.mp4")
    assert len(shown) == len(read[VIEW])
    assert max(apart(one, by_lerobot) for one, by_lerobot in zip(shown, read[VIEW], strict=True)) < PICTURE


def test_lerobot_reads_depths_in_millimetres(tmp_path: Path) -> None:
    run, out = tmp_path / "run", tmp_path / "set"
    shape = ("--headless", "--camera", "simulated-d435", "--goal", "I", "--start", "I", "--out", str(run))
    assert execute(["shape", *shape]) == 0
    assert execute(["export", str(run), "--to", "lerobot", "--width-px", "160", "--out", str(out)]) == 0

    depth_mm = read_by_lerobot(out, tmp_path)["observation.images.depth"]

    assert depth_mm.shape[1:] == (1, 120, 160)
    assert 500 < np.median(depth_mm) < 1500  # the table is a metre away
