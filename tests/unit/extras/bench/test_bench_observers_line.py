"""Arguments of `dlokit bench observers`."""

from pathlib import Path

import pytest
import tyro

from dlokit.extras.bench.commands.observers import ObserversArgs


@pytest.mark.parametrize(
    "line",
    [
        "--sequence a.npz b.npz c.npz",
        "--sequence a.npz --sequence b.npz c.npz",
        "--sequence a.npz b.npz --sequence c.npz",
    ],
)
def test_sequences_may_be_named_in_one_go_or_again_and_again(line: str) -> None:
    args = tyro.cli(ObserversArgs, args=line.split())
    assert [path for group in args.sequence for path in group] == [Path("a.npz"), Path("b.npz"), Path("c.npz")]
