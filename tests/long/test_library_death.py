"""`dlokit.live`: what a script sees when a process of its system dies."""

import os
from pathlib import Path

import pytest
from live_systems import started_by

import dlokit
from dlokit.errors import ProcessFailure


def test_the_death_of_a_process_is_an_error_by_name(tmp_path: Path) -> None:
    def lose_the_cell() -> None:
        with dlokit.live(out=tmp_path / "run", progress=False) as system:
            started_by(os.getpid())["cell"].kill()
            system.robot.home()

    with pytest.raises(ProcessFailure, match="cell"):
        lose_the_cell()
    assert not started_by(os.getpid())
