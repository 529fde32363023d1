"""The first words of the command line: a misspelt command, and options that several commands have."""

from pathlib import Path

import pytest

from dlokit.app.commands import GONE, execute, parse
from dlokit.app.shape.demo import DemoArgs
from dlokit.errors import InputError


@pytest.mark.parametrize(("typed", "meant"), [(["shpae"], "shape"), (["bench", "shapin"], "shaping")])
def test_a_misspelt_command_is_refused_with_the_most_similar_one(typed: list[str], meant: str) -> None:
    with pytest.raises(InputError, match=f"'{typed[-1]}'.*'{meant}'"):
        execute(typed)


@pytest.mark.parametrize(("name", "study"), GONE.items())
def test_a_command_that_has_gone_is_refused_with_the_study_that_it_became(name: str, study: str) -> None:
    with pytest.raises(InputError, match=f"`dlokit {name}` is a study now: python {study}, in a clone"):
        execute([*name.split(), "--help"])
    assert (Path(__file__).parents[3] / study).is_file()


def test_the_viewers_port_has_one_name() -> None:
    demo = parse(["demo", "--port", "8090"])
    assert isinstance(demo, DemoArgs)
    assert demo.port == 8090
    assert parse(["shape", "--port", "8090"]).run.viewer.port == 8090
    assert parse(["doctor", "--port", "8090"]).port == 8090
