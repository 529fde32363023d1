"""The wish on posts, from the command line and the Python API to the goal and the result."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from made_results import made_run

from dlokit.app.commands import parse
from dlokit.description.passing import parse_wish, passing
from dlokit.description.scene import Post
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError, ShapeError
from dlokit.recording.channels import FILE_NAME
from dlokit.recording.writer import RecordingWriter
from dlokit.system.configuration.recorded import recorded_config
from dlokit.system.job import job_from_config
from dlokit.system.replay import replayable
from dlokit.system.request import Choices, RunRequest
from dlokit.system.results.recording import run_metadata
from dlokit.system.results.run_result import read_result, write_result
from dlokit.types.passing import SideWish

FILE = """[[fixtures]]
kind = "post"
name = "A"
position_m = [0.54, -0.1, 0.0]

[[fixtures]]
kind = "post"
name = "B"
position_m = [0.50, 0.1, 0.0]
"""
WISH = (SideWish(name="A", turn=1), SideWish(name="B", turn=-1))
"""How an I passes them, which runs along +y through x = 0.52 m."""


@pytest.fixture
def posts(tmp_path: Path) -> str:
    path = tmp_path / "posts.toml"
    path.write_text(FILE)
    return str(path)


@pytest.mark.parametrize("said", [["--beside", "+A -B"], ["--beside=+A -B"]])
def test_the_flag_names_posts_of_the_scene(posts: str, said: list[str]) -> None:
    assert parse(["shape", "--fixtures", posts, *said]).run.wish == WISH


def test_a_value_that_begins_with_a_sign_is_a_value(posts: str) -> None:
    for said in (["--beside", "-A"], ["--beside", "-A +B"]):
        run = parse(["shape", "--goal", "interactive", "--fixtures", posts, *said, "--seed", "3"]).run
        assert (run.wish[0], run.seed) == (SideWish(name="A", turn=-1), 3)


def test_an_unknown_name_is_refused_with_the_allowed_ones(posts: str) -> None:
    with pytest.raises(ConfigError, match="names C, which is no post; the posts are A, B"):
        parse(["shape", "--fixtures", posts, "--beside", "C"])
    with pytest.raises(ConfigError, match="the scene has none"):
        RunRequest(settings={"beside": "+A"}).configured()


def test_a_wish_that_contradicts_the_goal_is_refused(posts: str) -> None:
    def goal(name: str, beside: str) -> object:
        request = RunRequest(choices=Choices(fixtures=posts), settings={"goal": name, "beside": beside})
        return job_from_config(request.configured())

    goal("I", "+A -B")
    with pytest.raises(
        ShapeError, match=r"--beside '-A' contradicts the goal I, which passes A clockwise: correct one"
    ):
        goal("I", "-A")
    with pytest.raises(ShapeError, match="which passes A before B"):
        goal("I", "-B +A")


def test_a_replayed_model_gets_the_recorded_wish(posts: str, tmp_path: Path) -> None:
    config = RunRequest(choices=Choices(fixtures=posts), settings={"beside": "+A -B"}).configured()
    path = tmp_path / FILE_NAME
    RecordingWriter(path, run_metadata(config, "among posts")).close()
    assert recorded_config(path, replayable()["model"]).wish == WISH


def test_a_result_keeps_how_the_posts_are_passed(tmp_path: Path) -> None:
    fixtures = (Post(name="A", position_m=(0.54, -0.1, 0.0)),)
    found = passing(builtin_shape("I", 0.5, 41), fixtures, parse_wish("+A", fixtures))
    result = msgspec.structs.replace(made_run(()), passing=found)
    write_result(tmp_path, result)
    assert read_result(tmp_path).passing == found
    write_result(tmp_path, made_run(()))
    assert read_result(tmp_path).passing is None
    assert np.isfinite(found.answers[0].margin_m)
