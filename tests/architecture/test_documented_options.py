"""Every `--option` on a page is an option of `dlokit`, of its checks of a device, or of a study in `benchmarks/`."""

import contextlib
import io
import re
from dataclasses import fields
from importlib import import_module
from pathlib import Path

import pytest

from dlokit.app.commands import parse
from dlokit.extras.checks.command import CameraCheckArgs, RobotCheckArgs
from dlokit.functional.cameras.strategies import CAMERAS
from dlokit.skills.observer.config import OURS as OBSERVERS
from dlokit.skills.perception.config import OURS as SEGMENTATIONS
from dlokit.skills.planning.config import OURS as PLANNERS

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"```.*?```", re.DOTALL)
INLINE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
OPTION = re.compile(r"(?<![\w-])--[a-z][\w-]*(?:\.[a-z][\w-]*)*")
OF_OTHERS = {"--nthreads", "--ros-args", "--user", "--packages-select"}
"""Options of Dask, on the page about clusters, and of ROS 2, Docker and colcon, on the page about ROS 2."""
SUBCOMMAND = re.compile(r"\{([\w,]+)\}")


def help_of(*arguments: str) -> str:
    """What `dlokit … --help all` prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit):
        parse([*arguments, "--help", "all"])
    return printed.getvalue()


def subcommands(page: str) -> list[str]:
    found = SUBCOMMAND.search(page.split("options")[0])
    return found[1].split(",") if found else []


@pytest.fixture(scope="module")
def known() -> set[str]:
    """All options of all commands, with the settings of every strategy."""
    pages = [help_of()]
    for command in subcommands(help_of()):
        pages.append(help_of(command))
        pages += [help_of(command, name) for name in subcommands(pages[-1])]
    pages += [help_of("doctor", device) for device in ("franka", "ros2")]
    pages += [help_of("shape", "--observer", config.name) for config in OBSERVERS]
    pages += [help_of("shape", "--planner", config.name) for config in PLANNERS]
    pages += [help_of("shape", "--camera", config.name) for config in CAMERAS.installed().values()]
    pages += [help_of("track", "--segmentation", config.name) for config in SEGMENTATIONS]
    return {option for page in pages for option in OPTION.findall(page)} | options_of_programs()


def options_of_programs() -> set[str]:
    """Those of the studies, and of the checks of a camera and a robot."""
    studies = [import_module(path.stem).Args for path in (ROOT / "benchmarks").glob("*.py")]
    studies += [CameraCheckArgs, RobotCheckArgs]
    return {f"--{field.name.replace('_', '-')}" for study in studies for field in fields(study)}


def test_the_options_are_found_in_help_and_pages(known: set[str]) -> None:
    assert {"--planner", "--goal", "--cell.dlo.length-m", "--jobs", "--observer.strategy.beta-m"} <= known
    assert sum(len(spoken_of(page)) for page in PAGES) > 100


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_every_option_on_a_page_exists(page: Path, known: set[str]) -> None:
    # `--cell.dlo` means all options with this prefix.
    groups = {option[:end] for option in known for end in (dot.start() for dot in re.finditer(r"\.", option))}
    assert sorted(spoken_of(page) - known - groups - OF_OTHERS) == []


def spoken_of(page: Path) -> set[str]:
    """The options in the running text of a page; `test_documentation.py` parses whole commands."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    return {option for code in INLINE.findall(text) for option in OPTION.findall(code)}
