"""Input that `dlokit bench stop` refuses before it starts a system."""

from pathlib import Path

import pytest

from dlokit.app.commands import execute
from dlokit.errors import ConfigError, InputError


@pytest.mark.parametrize(
    "arguments",
    [
        ("--kills", "-1"),
        ("--freezes", "-1"),
        ("--feedback-losses", "-1"),
        ("--presses", "-1"),
        ("--busy", "-1"),
        ("--quiet-s", "-0.5"),
        ("--quiet-s", "nan"),
        ("--quiet-s", "inf"),
    ],
)
def test_a_number_below_zero_and_an_endless_measurement_are_refused(arguments: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match="--quiet-s must be 0 or greater"):
        execute(["bench", "stop", *arguments])


def test_a_folder_for_the_figures_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="create it or name another"):
        execute(["bench", "stop", "--json", str(tmp_path / "missing" / "stop.json")])
