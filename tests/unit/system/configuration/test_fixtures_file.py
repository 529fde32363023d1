"""Fixtures come from an installation file or a file of their own, and what is wrong in it is named."""

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import Delaunay

from dlokit.description.scene import Box, Post
from dlokit.description.shapes import builtin_shape
from dlokit.errors import ConfigError
from dlokit.geometry import resample
from dlokit.system.config import RunConfig
from dlokit.system.configuration.installation_checks import check_installation
from dlokit.system.configuration.installation_file import with_fixtures, with_installation
from dlokit.system.configuration.toml_config import from_toml, to_toml
from dlokit.system.request import Choices, RunRequest

ROOT = Path(__file__).parents[4]
POST = '[[fixtures]]\nkind = "post"\nname = "A"\nposition_m = [0.45, 0.10, 0.0]\n'
BOX = '[[fixtures]]\nkind = "box"\nname = "lid"\nposition_m = [0.55, -0.1, 0.0]\nsize_m = [0.1, 0.04, 0.03]\n'
READ = (
    Post(name="A", position_m=(0.45, 0.10, 0.0)),
    Box(name="lid", position_m=(0.55, -0.1, 0.0), size_m=(0.1, 0.04, 0.03)),
)


def read(tmp_path: Path, text: str) -> RunConfig:
    file = tmp_path / "posts.toml"
    file.write_text(text)
    return with_fixtures(RunConfig(), file)


def test_both_files_take_the_same_fixtures(tmp_path: Path) -> None:
    assert read(tmp_path, POST + BOX).scene.fixtures == READ
    assert with_installation(RunConfig(), tmp_path / "posts.toml").scene.fixtures == READ


def test_a_file_of_fixtures_replaces_those_of_the_installation_and_nothing_else(tmp_path: Path) -> None:
    lab, posts = tmp_path / "lab.toml", tmp_path / "posts.toml"
    lab.write_text("[table]\nposition_m = [0.0, 0.0, 0.08]\n" + BOX)
    posts.write_text(POST)
    installed = RunRequest(choices=Choices(installation=lab)).configured()
    both = RunRequest(choices=Choices(fixtures=posts, installation=lab)).configured()
    assert installed.scene.fixtures == READ[1:]
    assert both.scene.fixtures == READ[:1]
    assert both.installation.table == installed.installation.table


def test_fixtures_survive_the_way_through_the_configuration_of_a_run(tmp_path: Path) -> None:
    run = read(tmp_path, POST + BOX)
    assert from_toml(to_toml(run), RunConfig, "config.toml") == run


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (POST.replace('"post"', '"clip"'), "fixtures[0]: unknown kind 'clip'; allowed: post, box"),
        (POST.replace('kind = "post"\n', ""), "fixtures[0]: lacks `kind`; allowed: post, box"),
        (POST.replace('name = "A"\n', ""), "fixtures[0]: lacks name; add it"),
        (BOX + POST.replace("position_m = [0.45, 0.10, 0.0]\n", ""), "fixtures[1]: lacks position_m; add it"),
        (POST + "hight_m = 0.02\n", "fixtures[0]: unknown key hight_m (did you mean height_m?); allowed: diameter_m"),
        (POST + "height_m = 25\n", "fixtures[0]: the fixture A: height_m is 25"),
        (POST.replace(", 0.0]", "]"), "fixtures[0]: position_m: Expected `array` of length 3, got 2"),
        (POST.replace("[[fixtures]]", "[fixtures]"), "fixtures is not a list of tables: write [[fixtures]]"),
        (POST + POST, "two fixtures are called A"),
        ("[table]\n" + POST, "unknown key table; allowed: fixtures"),
        ("post A at 0.45\n", "is not TOML"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(says)) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(str(tmp_path / "posts.toml"))


def test_a_fixture_in_the_base_of_an_arm_is_refused_before_the_start(tmp_path: Path) -> None:
    run = read(tmp_path, POST.replace("0.45, 0.10", "0.0, 0.0"))
    with pytest.raises(ConfigError, match="the fixture A stands in the base of the first arm"):
        check_installation(run)


def test_a_kind_of_fixture_comes_with_no_package(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"allowed: post, box$"):
        read(tmp_path, POST.replace('"post"', '"clip"'))


@pytest.mark.parametrize("text", [None, "post A at 0.45\n"])
def test_a_file_that_cannot_be_read_is_named_with_the_page_that_describes_it(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "posts.toml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(ConfigError, match=r"posts\.toml.*describe-fixtures"):
        with_fixtures(RunConfig(), file)


def test_the_file_in_the_documentation_has_every_key_with_its_default(tmp_path: Path) -> None:
    page = (ROOT / "docs/how-to/describe-fixtures.md").read_text()
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    post, box = read(tmp_path, text).scene.fixtures
    assert post == Post(name="A", position_m=post.position_m)
    assert isinstance(box, Box)
    for part, kind in zip(text.split("[[fixtures]]")[1:], (Post, Box), strict=True):
        for field in fields(kind):
            assert re.search(rf"^{field.name} = ", part, re.MULTILINE), (kind, field.name)


def test_the_posts_of_the_example_stand_inside_the_bends_of_the_goal_and_beside_the_start() -> None:
    run = with_fixtures(RunConfig(), ROOT / "examples/fixtures/posts.toml")
    goal, start = (resample(builtin_shape(name, 0.5, 31)[:, :2], 1001) for name in ("S", "I"))
    bends = [Delaunay(half) for half in (goal[:501], goal[500:])]
    assert [post.name for post in run.scene.posts] == ["A", "B", "C", "D"]
    for number, post in enumerate(run.scene.posts):
        place = np.array(post.position_m[:2])
        assert 0.012 < np.linalg.norm(goal - place, axis=1).min() < 0.025
        assert np.linalg.norm(start - place, axis=1).min() > 0.04  # fingers have room beside the start
        assert [int(bend.find_simplex(place)) >= 0 for bend in bends] == [number < 2, number >= 2]
