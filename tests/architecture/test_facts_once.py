"""Each fact is defined once: a number or a definition in two places is a latent defect."""

import re
from pathlib import Path

import pytest

import dlokit
from dlokit.app.doctor.machine import opengl_finding
from dlokit.app.doctor.opengl import OpenGLReport
from dlokit.types.robot import RobotReason

ROOT = Path(__file__).parents[2]
SOURCE = Path(dlokit.__file__).parent


def homes(pattern: str) -> list[str]:
    return sorted(
        path.relative_to(SOURCE).as_posix()
        for path in SOURCE.rglob("*.py")
        if re.search(pattern, path.read_text(encoding="utf-8"), re.MULTILINE)
    )


@pytest.mark.parametrize(
    ("pattern", "home"),
    [
        (r"\b9\.81\b", "description/dlo.py"),
        (r"^\w+(: TypeAlias)? = (NDArray|np\.ndarray)\[", "types/arrays.py"),
        (r"\b0\.30, 0\.75\b|\b0\.45, 0\.0\b", "description/table.py"),
        (r"capsule\.radius_m for capsule in self\.capsules", "description/arm/model.py"),
        (r"\b0\.(333|316|384|088)\b", "description/arm/franka.py"),
        (r"^_?(ROUNDING|TURN_LEVER|SHORTEST)_M = |^_?SHARPEST", "motion/tool_path.py"),
        (r"^_?(APPROACH|RETREAT)_HEIGHT_M = |lift_m: float = 0", "types/action.py"),
        (r"truth\.npz\"", "functional/cell/truth.py"),
        (r"apt install libegl1", "app/doctor/machine.py"),
        (r"-m pip install|pip_command\(f?\"dlokit", "errors.py"),
    ],
)
def test_it_is_defined_in_one_file(pattern: str, home: str) -> None:
    assert homes(pattern) == [home]


@pytest.mark.parametrize("name", ["Makefile", "Dockerfile"])
def test_the_packages_of_opengl_are_those_that_the_doctor_names(name: str) -> None:
    fix = opengl_finding(OpenGLReport(works=False, text="")).fix.removeprefix("sudo apt install ")
    assert re.findall(r"libegl1\b[\w -]*?-dri", (ROOT / name).read_text(encoding="utf-8")) == [fix]


def test_no_quantity_is_taken_from_a_step_of_the_flow() -> None:
    """A length or a time that others need, too, is defined below all of them."""
    taken = homes(r"from dlokit\.decision\.steps\.\w+ import .*\b[A-Z_]+_(M|M_S|S|N|RAD)\b")
    assert [home for home in taken if not home.startswith("decision/")] == []


def test_no_two_classes_share_a_name() -> None:
    found: dict[str, list[str]] = {}
    for path in SOURCE.rglob("*.py"):
        for name in re.findall(r"^class ([A-Z]\w*)", path.read_text(encoding="utf-8"), re.MULTILINE):
            found.setdefault(name, []).append(path.relative_to(SOURCE).as_posix())
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


@pytest.mark.parametrize(
    ("word", "rooms"),
    [
        ("Episode", ("extras/gym/", "extras/export/")),  # of Gymnasium and LeRobot
        ("Task", ("decision/", "types/", "system/results/")),  # what the decision layer does, and its results
        ("Trial", ("extras/bench/",)),  # one run of a bench
        ("LeaseKeeper", ("system/live.py",)),  # what keeps leases, by heartbeats
    ],
)
def test_a_word_in_the_names_of_classes_has_one_meaning(word: str, rooms: tuple[str, ...]) -> None:
    assert [home for home in homes(rf"^class \w*{word}") if not home.startswith(rooms)] == []


def test_only_the_camera_geometry_projects_points() -> None:
    """Except the observer's compiled kernel, which takes the camera as plain numbers."""
    world_to_camera = r"T_world_camera\.position_m\) @ rotation\(|inverse\(\w+\.T_world_camera\), nodes"
    pixel = r"\.f[xy]_px \* \w+(\[[^]]*\])? / "
    assert homes(rf"{world_to_camera}|{pixel}") == ["geometry/camera.py"]


ROBOT_CODE = ("motion", "functional/robots", "functional/cell/setpoints.py", "skills/robot", "decision/steps")


def test_the_robots_reasons_are_written_only_in_their_declaration() -> None:
    """So that each new reason is declared with its remedy, and not repeated elsewhere."""
    reasons = "|".join(reason.value for reason in RobotReason)
    raised = rf"(SkillFailure|SkillRejected)\(\s*\"|[=,({{]\s*\"({reasons})\""
    assert [home for home in homes(raised) if home.startswith(ROBOT_CODE)] == []
