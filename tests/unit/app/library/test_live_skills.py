"""`dlokit.live` has a method for each skill that people call."""

from dlokit.app.library import live_skills
from dlokit.app.operate.skills import all_skills

OF_DRIVERS = ("cell.", "ros.")
"""What only drivers call."""


def test_every_skill_that_people_call_is_a_method() -> None:
    methods = {
        method.skill.key
        for skills in vars(live_skills).values()
        if isinstance(skills, type) and issubclass(skills, live_skills.Skills)
        for method in vars(skills).values()
        if isinstance(method, live_skills.SkillMethod)
    }
    assert callable(live_skills.PerceptionSkills.look)
    methods.add("perception.look")  # a method of its own, which returns the points as well
    own = {"robot.renew_lease", "robot.release_lease", "robot.confirm_start"}  # the system's
    assert methods == {key for key in all_skills() if not key.startswith(OF_DRIVERS)} - own
