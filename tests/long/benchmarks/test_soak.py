"""The samples and the slopes of a soak."""

import mmap
import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from pathlib import Path

import msgspec
import psutil
import pytest

from parts import soak_samples
from parts.soak_samples import SAMPLE_EVERY_S, Sample, take_sample
from soak import samples_of, slope, sum_of_minima

LIMIT_S = 60.0  # a process of Python starts in a second
TIMES_S = [SAMPLE_EVERY_S * number for number in range(3000)]


def test_a_leak_below_a_load_that_comes_and_goes_is_its_slope() -> None:
    grows = [100.0 + 3.0 * at_s / 3600.0 + (20.0 if number % 5 else 0.0) for number, at_s in enumerate(TIMES_S)]
    found = slope(TIMES_S, grows, min, from_s=1800.0)
    assert found.value == pytest.approx(3.0, abs=0.1)  # the least sample is 0 to 12 s after the begin of its block
    assert found.low is not None
    assert found.high is not None
    assert found.low < 3.0 < found.high


def test_a_figure_that_does_not_change_has_the_slope_zero_and_no_uncertainty() -> None:
    found = slope(TIMES_S, [447.0] * len(TIMES_S), min, from_s=1800.0)
    assert (found.value, found.low, found.high) == (0.0, 0.0, 0.0)


def test_a_soak_of_few_samples_has_no_slope() -> None:
    assert slope(TIMES_S[:2], [1.0, 2.0], min, from_s=0.0).low is None


def test_the_figure_of_a_block_is_the_sum_of_each_process_that_ran_throughout() -> None:
    assert sum_of_minima([{1: 5.0, 2: 9.0}, {1: 7.0, 2: 8.0, 3: 1.0}]) == 13.0


@pytest.fixture
def child() -> Generator[int]:
    """A process id of a child of this process."""
    waits = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    yield waits.pid
    waits.communicate(b"\n", timeout=LIMIT_S)


def test_samples_are_in_a_file_and_the_process_that_samples_does_not_count(tmp_path: Path, child: int) -> None:
    file = tmp_path / "samples.jsonl"
    command = (sys.executable, soak_samples.__file__, str(os.getpid()), "0", file)
    subprocess.run(command, stdin=subprocess.DEVNULL, timeout=LIMIT_S, check=True)
    (sample,) = samples_of(file)
    uses = {use.pid: use for use in sample.processes}
    assert uses.keys() == {os.getpid(), *(each.pid for each in psutil.Process().children(recursive=True))}
    assert child in uses
    assert uses[os.getpid()].name == "decision"
    assert uses[os.getpid()].threads == psutil.Process().num_threads()


def test_a_process_that_is_named_does_not_count(child: int) -> None:
    def sampled(others: list[int]) -> set[int]:
        return {use.pid for use in take_sample(psutil.Process(), others, 0.0).processes}

    assert child in sampled([])
    assert child not in sampled([child])


def test_shared_memory_that_two_processes_have_mapped_counts_once() -> None:
    with tempfile.NamedTemporaryFile(dir="/dev/shm") as file:
        file.truncate(2_000_000)
        maps = f"import mmap; f = open({file.name!r}, 'r+b'); m = mmap.mmap(f.fileno(), 0); print(flush=True); input()"
        other = subprocess.Popen([sys.executable, "-c", maps], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert other.stdout is not None
        other.stdout.readline()
        without, once = (take_sample(psutil.Process(), named, 0.0).shared_mb for named in ([other.pid], []))
        with mmap.mmap(file.fileno(), 0):
            twice = take_sample(psutil.Process(), (), 0.0).shared_mb
        other.communicate(b"\n", timeout=LIMIT_S)
    assert once - without == pytest.approx(2.0, abs=0.01)  # whole pages of 4 kB
    assert twice == once


def test_a_line_that_is_being_written_is_no_sample(tmp_path: Path) -> None:
    sample = Sample(time_s=1.0, shared_mb=2.0, load=3.0, processes=[])
    (tmp_path / "samples.jsonl").write_bytes(msgspec.json.encode(sample) + b'\n{"time_s"')
    assert list(samples_of(tmp_path / "samples.jsonl")) == [sample]
