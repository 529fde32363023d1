"""The list of skills: units by name, selection by key, and the reference page."""

from pathlib import Path

import pytest

from dlokit.app.operate.skills import SkillsArgs, all_skills, arguments_of, renewed, run, skill_named, type_text
from dlokit.decision.api import SHAPE_DLO
from dlokit.errors import InputError
from dlokit.skills.robot import api as robot
from dlokit.types.arrays import Float64Array

PAGE = Path(__file__).parents[4] / "docs" / "reference" / "skills.md"


def test_the_reference_page_has_the_skills_as_they_are() -> None:
    page = PAGE.read_text(encoding="utf-8")
    assert page == renewed(page, str(PAGE)), "renew it: dlokit skills --write docs/reference/skills.md"


def test_arguments_have_types_units_and_defaults() -> None:
    (width,) = arguments_of(robot.RELEASE)
    assert (width.name, width.kind, width.unit, width.default) == ("width_m", "float", "m", "0.04")
    target, velocity = arguments_of(robot.MOVE_LINEAR)
    assert (target.kind, target.unit, target.default) == ("Pose", "", "")
    assert velocity.kind == "VelocityProfile"
    goal, threshold = arguments_of(SHAPE_DLO)[:2]
    assert goal.kind == "str or GoalRequest"
    assert (threshold.kind, threshold.unit, threshold.default) == ("float or None", "m", "None")
    assert type_text(Float64Array) == "array of float64"


def test_a_skill_is_found_by_its_key_and_by_that_of_an_instance() -> None:
    assert skill_named("robot.home") == robot.HOME
    assert skill_named("robot.second.home") == robot.HOME.at("second")
    assert set(all_skills()) >= {"decision.shape_dlo", "robot.stop", "perception.look"}


@pytest.mark.parametrize(
    ("key", "said"), [("robot.fly", "robot.home"), ("conveyor.move", "COMPONENT.SKILL"), ("home", "COMPONENT.SKILL")]
)
def test_an_unknown_skill_is_refused_with_the_known_ones(key: str, said: str) -> None:
    with pytest.raises(InputError, match=key) as refused:
        skill_named(key)
    assert said in str(refused.value)


def test_a_page_without_marks_is_refused() -> None:
    with pytest.raises(InputError, match="has no lines"):
        renewed("# Skills\n", "skills.md")


def test_a_page_that_is_not_there_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--write .*none\.md"):
        run(SkillsArgs(write=tmp_path / "none.md"))
