"""The looks and the slopes of a soak."""

import os
from pathlib import Path

import psutil
import pytest

from soak import LOOK_EVERY_S, Soak, slope, sum_of_minima

TIMES_S = [LOOK_EVERY_S * number for number in range(3000)]


def test_a_leak_below_a_load_that_comes_and_goes_is_its_slope() -> None:
    grows = [100.0 + 3.0 * at_s / 3600.0 + (20.0 if number % 5 else 0.0) for number, at_s in enumerate(TIMES_S)]
    found = slope(TIMES_S, grows, min, from_s=1800.0)
    assert found.value == pytest.approx(3.0, abs=0.1)  # the least look is 0 to 12 s after the begin of its block
    assert found.low is not None
    assert found.high is not None
    assert found.low < 3.0 < found.high


def test_a_figure_that_does_not_change_has_the_slope_zero_and_no_uncertainty() -> None:
    found = slope(TIMES_S, [447.0] * len(TIMES_S), min, from_s=1800.0)
    assert (found.value, found.low, found.high) == (0.0, 0.0, 0.0)


def test_a_soak_of_few_looks_has_no_slope() -> None:
    assert slope(TIMES_S[:2], [1.0, 2.0], min, from_s=0.0).low is None


def test_the_figure_of_a_block_is_the_sum_of_each_process_that_ran_throughout() -> None:
    assert sum_of_minima([{1: 5.0, 2: 9.0}, {1: 7.0, 2: 8.0, 3: 1.0}]) == 13.0


def test_what_each_look_saw_is_in_a_file(tmp_path: Path) -> None:
    soak = Soak(tmp_path / "looks.csv")
    for at_s in (1.0, 2.0):
        soak.look(at_s)
    first, second = soak.of_processes("descriptors")
    assert first[os.getpid()] == second[os.getpid()] == psutil.Process().num_fds()
    assert soak.of_processes("memory")[1][os.getpid()] == dict(row[:2] for row in soak.newest)[os.getpid()]
    assert (tmp_path / "looks.csv").read_text().splitlines()[0] == "time_s,process,pid,memory,descriptors,threads"
