"""A whole task with the driver of the Franka against franky-sim, while the cell mirrors its arm: `make test-peers`."""

import os
from pathlib import Path

import pytest
from franky_server import why_not

from dlokit.types.flow import RunOutcome
from parts.franka_twin_run import mirrored, twin_config, twin_run

pytestmark = [pytest.mark.peers, pytest.mark.skipif(bool(why_not()), reason=why_not() or "it can run")]


def test_a_task_converges_while_the_cell_mirrors_the_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = twin_run(twin_config("I", "S", 0), tmp_path)
    found = mirrored(tmp_path)
    with capsys.disabled():
        print(f"\n{result.outcome.value}, {result.actions} actions, {found}, load {os.getloadavg()[0]:.1f}")
    assert result.outcome is RunOutcome.CONVERGED
    assert result.twin
    assert any(action.grasp_ok for action in result.history)
    assert found.driver_hz >= 100.0
    assert found.twin_hz >= 50.0
    assert found.largest_rad <= 0.025
