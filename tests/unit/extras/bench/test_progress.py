"""Terminal output of a sweep, including an interrupted one."""

import io
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from dlokit.errors import InputError
from dlokit.extras.bench.commands.shaping import followed
from dlokit.extras.bench.report import check_json


def two_then_interrupted() -> Iterator[int]:
    yield 1
    yield 2
    raise KeyboardInterrupt


def followed_on(console: Console, runs: Iterator[int]) -> list[int]:
    return followed(
        runs,
        3,
        Path("sweep"),
        console,
        line_of=lambda number: f"number {number}",
        print_all=lambda numbers: console.print(f"all: {numbers}"),
    )


def test_every_run_has_a_line_and_the_sweep_a_table() -> None:
    console = Console(file=io.StringIO())
    assert followed_on(console, iter([1, 2, 3])) == [1, 2, 3]
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().splitlines() == ["1/3 number 1", "2/3 number 2", "3/3 number 3", "all: [1, 2, 3]"]


def test_an_interrupted_sweep_prints_finished_runs_and_the_command_to_continue() -> None:
    console = Console(file=io.StringIO())
    with pytest.raises(KeyboardInterrupt):
        followed_on(console, two_then_interrupted())
    assert isinstance(console.file, io.StringIO)
    assert console.file.getvalue().splitlines()[-2:] == [
        "all: [1, 2]",
        "2 of 3 runs are finished; the same command with --out sweep continues.",
    ]


def test_a_sweep_interrupted_at_once_has_no_table() -> None:
    def at_once() -> Iterator[int]:
        raise KeyboardInterrupt
        yield

    console = Console(file=io.StringIO())
    with pytest.raises(KeyboardInterrupt):
        followed_on(console, at_once())
    assert isinstance(console.file, io.StringIO)
    assert "all" not in console.file.getvalue()


def test_a_file_of_figures_in_a_folder_that_does_not_exist_is_named_before_the_first_run(tmp_path: Path) -> None:
    check_json(None)
    check_json(tmp_path / "figures.json")
    with pytest.raises(InputError, match=r"--json .*gone/figures\.json: folder .*gone does not exist; create it"):
        check_json(tmp_path / "gone" / "figures.json")
