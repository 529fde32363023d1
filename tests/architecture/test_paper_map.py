"""The map from the paper to the code names only what exists, and omits no component or step."""

import re
from pathlib import Path

from dlokit.decision.shape_flow import SHAPE_DLO
from dlokit.system.table import COMPONENTS

ROOT = Path(__file__).parents[2]
MAP = (ROOT / "docs" / "paper_map.md").read_text(encoding="utf-8")
PLACES = (ROOT / "src" / "dlokit", ROOT / "tests", ROOT)
QUOTED = sorted(set(re.findall(r"`([^`\s]+)`", MAP)))


def found(path: str) -> Path | None:
    return next((place / path for place in PLACES if (place / path).exists()), None)


def test_every_path_on_the_map_exists() -> None:
    paths = [name for name in QUOTED if re.search(r"/|\.(py|md|toml|npz)$", name) and "::" not in name]
    assert len(paths) > 60  # the pattern still finds them
    assert [path for path in paths if found(path) is None] == []


def test_every_test_on_the_map_exists() -> None:
    tests = [name.split("::") for name in QUOTED if "::" in name]
    assert len(tests) > 40  # the pattern still finds them
    missing: list[str] = []
    for file, function in tests:
        path = found(file)
        if path is None or f"def {function}(" not in path.read_text(encoding="utf-8"):
            missing.append(f"{file}::{function}")
    assert missing == []


def test_every_component_has_its_row() -> None:
    called = {"robot": "robot control"}  # in the paper
    kinds = dict.fromkeys(name.partition(".")[0] for name in COMPONENTS)
    assert [name for name in kinds if f"\n| {called.get(name, name)} |" not in MAP] == []


def test_every_step_and_every_end_of_the_flow_chart_is_on_the_map() -> None:
    boxes = [step.name for step in SHAPE_DLO.steps] + [end.name for end in SHAPE_DLO.ends if end.name != "converged"]
    assert [box for box in boxes if f"`{box}`" not in MAP] == []


def test_every_example_is_on_the_map() -> None:
    examples = [path.relative_to(ROOT).as_posix() for path in (ROOT / "examples").glob("[0-9]*.py")]
    assert [example for example in examples if f"`{example}`" not in MAP] == []
