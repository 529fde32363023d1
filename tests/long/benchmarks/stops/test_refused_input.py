"""Input that the study of stops refuses before it starts a system."""

from pathlib import Path
from typing import Any

import pytest

from dlokit.errors import ConfigError, InputError
from stops import Args, run


@pytest.mark.parametrize(
    "wrong",
    [
        {"kills": -1},
        {"freezes": -1},
        {"feedback_losses": -1},
        {"presses": -1},
        {"busy": -1},
        {"quiet_s": -0.5},
        {"quiet_s": float("nan")},
        {"quiet_s": float("inf")},
    ],
)
def test_a_number_below_zero_and_an_endless_measurement_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="--quiet-s must be 0 or greater"):
        run(Args(**wrong))


def test_a_folder_for_the_figures_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="create it"):
        run(Args(json=tmp_path / "missing" / "stop.json"))
