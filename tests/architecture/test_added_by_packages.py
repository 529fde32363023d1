"""What other packages add to the tables of components, processes and topics; and the pages that say how."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from installed_packages import install
from page_code import ROOT, blocks

from dlokit.communication.memory import MemoryTransport
from dlokit.communication.timing.clock import LoopClock
from dlokit.communication.topics import TOPICS, all_topics
from dlokit.errors import ConfigError
from dlokit.recording.channels import recorded_topics, topic_of
from dlokit.system.build import Wiring, build_component
from dlokit.system.config import RunConfig
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.system.table import (
    COMPONENTS,
    PROCESSES,
    ComponentRow,
    component_table,
    components_of_run,
    process_table,
    processes_of_run,
)

EXAMPLE = ROOT / "examples" / "speed_package"
PLANNER = ROOT / "examples" / "planner_package" / "src" / "dlokit_along"
ROS = "ros"
"""The component, and its process, that an annexe adds."""


@pytest.mark.parametrize(
    ("page", "file", "others"),
    [
        ("add-a-component.md", EXAMPLE / "dlokit_speed.py", 0),
        ("add-a-command.md", EXAMPLE / "dlokit_speed_command.py", 0),
        ("add-a-planner.md", PLANNER / "planner.py", 1),  # its object with `propose`: test_planners_tools.py runs it
    ],
)
def test_the_page_shows_the_example_as_it_is(page: str, file: Path, others: int) -> None:
    source = file.read_text(encoding="utf-8")
    shown = blocks(f"docs/how-to/{page}")
    assert len(shown) > others
    assert len([block for block in shown if block.strip() not in source]) == others


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of the import path, whose packages the tables of this test have."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(EXAMPLE)
    caches = (component_table, process_table, all_topics, recorded_topics)
    for cached in caches:
        cached.cache_clear()
    yield tmp_path
    for cached in caches:
        cached.cache_clear()
    sys.modules.pop("of_rows", None)


def test_a_component_of_another_package_is_part_of_runs_and_recordings(folder: Path) -> None:
    install(folder, "topics-of", "dlokit.topics", {"speed": "dlokit_speed:SPEED"}, {})
    install(folder, "components-of", "dlokit.components", {"speed": "dlokit_speed:ROW"}, {})
    run = RunConfig()
    assert components_of_run(run) == (*(name for name in COMPONENTS if name != "robot.second"), "speed")
    assert processes_of_run(run)[-1].components == ("speed",)
    assert topic_of("speed/node") is all_topics()[-1]
    wiring = Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=None, start_nodes_world=HIDDEN_START)
    assert build_component("speed", run, wiring).publishes == (all_topics()[-1],)


def test_a_component_whose_topic_is_not_registered_is_refused_before_the_run(folder: Path) -> None:
    install(folder, "components-of", "dlokit.components", {"speed": "dlokit_speed:ROW"}, {})
    wiring = Wiring(transport=MemoryTransport(), clock=LoopClock(), folder=None, start_nodes_world=HIDDEN_START)
    with pytest.raises(ConfigError, match=r"component speed publishes speed/node.*an entry point dlokit\.topics"):
        build_component("speed", RunConfig(), wiring)


def test_a_row_whose_class_is_missing_is_named_with_it() -> None:
    with pytest.raises(ConfigError, match="component lost cannot be loaded from dlokit_lost:C: No module named"):
        ComponentRow(name="lost", kind="dlokit_lost:C", process="camera").load()
    with pytest.raises(ConfigError, match=r"component lost cannot be loaded.* has no attribute 'Lost'"):
        ComponentRow(name="lost", kind="dlokit.system.table:Lost", process="camera").load()


@pytest.mark.parametrize("wrong", [{"kind": "module.Class"}, {"kind": "module:C", "when": "in_cell"}])
def test_a_row_says_what_it_must_be(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="kind must be module:Class, and when a function"):
        ComponentRow(name="odd", process="camera", **wrong)


ROWS = """
from dlokit.system.table import ComponentRow, ProcessRow, watched

row = ComponentRow(name="second_look", kind="nowhere:C", process="camera", when=watched)
taken = ComponentRow(name="observer", kind="nowhere:C", process="camera")
nowhere = ComponentRow(name="lost", kind="nowhere:C", process="attic")
thief = ComponentRow(name="thief", kind="nowhere:C", process=ProcessRow(name="robot", components=("thief",)))
other = "a text"
own = ProcessRow(name="own", components=("one", "two"))
one = ComponentRow(name="one", kind="nowhere:C", process=own)
two = ComponentRow(name="two", kind="nowhere:C", process=own)
"""


def test_a_component_may_run_in_a_process_of_dlokit_and_only_in_some_runs(folder: Path) -> None:
    install(folder, "rows", "dlokit.components", {"row": "of_rows:row"}, {"of_rows": ROWS})
    camera = next(row for row in processes_of_run(RunConfig()) if row.name == "camera")
    assert camera.components == ("perception", "second_look")
    assert "second_look" not in components_of_run(RunConfig(headless=True))
    headless = next(row for row in processes_of_run(RunConfig(headless=True)) if row.name == "camera")
    assert headless.components == ("perception",)


def test_two_components_may_share_a_process_of_their_own(folder: Path) -> None:
    install(folder, "rows", "dlokit.components", {"one": "of_rows:one", "two": "of_rows:two"}, {"of_rows": ROWS})
    (own,) = (row for row in process_table() if row.name == "own")
    assert own.components == ("one", "two")


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ("taken", "is called 'observer', as another"),
        ("nowhere", "its process 'attic' must be the name of one of dlokit's, camera, cell"),
        ("thief", "its process 'robot' must be"),
        ("other", "is a str; it must be a ComponentRow"),
    ],
)
def test_a_row_that_cannot_be_is_skipped_with_the_reason(
    folder: Path, caplog: pytest.LogCaptureFixture, entry: str, says: str
) -> None:
    install(folder, "rows", "dlokit.components", {entry: f"of_rows:{entry}"}, {"of_rows": ROWS})
    assert [*component_table()] == [*COMPONENTS, ROS]
    assert [row.name for row in process_table()] == [*(row.name for row in PROCESSES), ROS]
    assert says in caplog.text


def test_a_topic_whose_name_is_taken_is_skipped(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    source = "from dlokit.communication.topics import STATE as stolen"
    install(folder, "thief", "dlokit.topics", {"stolen": "of_topic_thief:stolen"}, {"of_topic_thief": source})
    assert all_topics() == TOPICS
    assert "is called 'model/state', as another" in caplog.text


def test_only_the_faces_of_the_library_name_an_annexe() -> None:
    source = ROOT / "src" / "dlokit"
    naming = {
        path.relative_to(source).as_posix()
        for path in source.rglob("*.py")
        if "dlokit.extras" in path.read_text(encoding="utf-8") and not path.is_relative_to(source / "extras")
    }
    faces = {"__init__.py", "bench.py", "gym.py", "testing.py"}
    # The search for entry points knows the name of the package, to be silent where it was left out.
    assert naming == {*faces, "communication/strategies.py"}
