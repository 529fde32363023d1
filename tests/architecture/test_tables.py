"""The two tables: each declaration of a component has a row, and each row has a component."""

import ast
import importlib
import inspect
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import pytest

import dlokit
from dlokit.communication import topics
from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.communication.topic import Topic
from dlokit.communication.topics import TOPICS
from dlokit.communication.wire import codec
from dlokit.description.arm.mounts import INSTANCES
from dlokit.errors import CommunicationError
from dlokit.functional.cameras.recorded import RecordedCameraConfig
from dlokit.system.config import RunConfig
from dlokit.system.table import COMPONENTS, DECISION, PROCESSES, components_of_run, instances_of_run, processes_of_run
from dlokit.types.dlo import DloState
from dlokit.types.outcome import Succeeded

pytestmark = pytest.mark.xdist_group("source_nodes")

SOURCE = Path(dlokit.__file__).parent
API_MODULES = sorted(
    ".".join(("dlokit", *path.relative_to(SOURCE).with_suffix("").parts))
    for layer in ("skills", "functional", "decision")
    for path in (SOURCE / layer).rglob("api.py")
)
SKILLS: list[Skill[..., Any]] = [
    value for name in API_MODULES for value in vars(importlib.import_module(name)).values() if isinstance(value, Skill)
]


CLASSES = {name: row.load() for name, row in COMPONENTS.items()}


def skill_id(skill: Skill[..., Any]) -> str:
    return skill.key


def topic_id(topic: Topic[Any]) -> str:
    return topic.name


def test_no_two_topics_have_one_name() -> None:
    assert len(TOPICS) > 10
    assert max(Counter(topic.name for topic in TOPICS).values()) == 1


@pytest.mark.parametrize("topic", TOPICS, ids=topic_id)
def test_a_topic_is_published_by_the_component_of_its_row_and_no_other(topic: Topic[Any]) -> None:
    publishers = {component.name for component in CLASSES.values() if topic in component.publishes}
    assert publishers == {topic.publisher}


@pytest.mark.parametrize("name", COMPONENTS)
def test_what_a_component_reads_and_publishes_are_rows(name: str) -> None:
    component = CLASSES[name]
    assert component.name == name.partition(".")[0]
    assert set(component.subscribes()) <= set(TOPICS)
    assert set(component.publishes) <= set(TOPICS)


@pytest.mark.parametrize("topic", TOPICS, ids=topic_id)
def test_a_topic_has_a_reader(topic: Topic[Any]) -> None:
    # The simulated drivers read the cell's arm through a separate port, which represents a cable.
    by_a_driver = {topics.CLOCK, topics.ARM_STATE}
    by_the_terminal = {topics.VIEWER_PAGE}
    by_the_result = {topics.PROTECTION}
    readers = [name for name, component in CLASSES.items() if topic in component.subscribes()]
    assert readers or topic in by_a_driver | by_the_terminal | by_the_result


def test_the_cell_publishes_its_time_and_its_arm_and_nothing_of_the_dlo() -> None:
    assert set(CLASSES["cell"].publishes) == {topics.CLOCK, topics.ARM_STATE}
    for skill in CLASSES["cell"].skills():
        result = get_type_hints(skill.signature)["return"]
        assert "nodes_world" not in names_within(result)


def names_within(kind: Any) -> set[str]:
    """Names of all fields of a message and of the messages within it."""
    if not (inspect.isclass(kind) and issubclass(kind, msgspec.Struct)):
        return set[str]().union(*(names_within(part) for part in get_args(kind)))
    hints = get_type_hints(kind)
    return set(hints).union(*(names_within(hint) for hint in hints.values()))


def test_the_search_for_the_true_shape_finds_it() -> None:
    assert "nodes_world" in names_within(DloState)
    assert "nodes_world" in names_within(tuple[DloState, ...])


def test_only_the_cell_records_truth_and_only_evaluation_reads_it(source_nodes: dict[str, tuple[ast.AST, ...]]) -> None:
    imports = [(tuple(place.split("/")[:2]), imported(nodes)) for place, nodes in source_nodes.items()]
    users = {place for place, names in imports if any(name.endswith(".truth") for name in names)}
    assert users
    assert users == {("functional", "cell"), ("evaluation", "evaluator.py"), ("evaluation", "judged_run.py")}
    evaluator = "dlokit.evaluation.evaluator"
    judges = {place for place, names in imports if any(name.startswith(evaluator) for name in names)}
    assert judges <= {("evaluation", "judged_run.py"), ("app", "shape"), ("extras", "bench"), ("extras", "export")}


def imported(nodes: Iterable[ast.AST]) -> set[str]:
    """The modules from which a file imports, and what it imports from them."""
    statements = [node for node in nodes if isinstance(node, ast.ImportFrom)]
    modules = {statement.module for statement in statements if statement.module}
    return modules | {f"{statement.module}.{alias.name}" for statement in statements for alias in statement.names}


@pytest.mark.parametrize("topic", TOPICS, ids=topic_id)
def test_every_topics_type_can_be_decoded(topic: Topic[Any]) -> None:
    # Nil is refused as a wrong value; a type that msgspec does not know would be refused before it looks.
    with pytest.raises(CommunicationError, match="Expected `object`"):
        codec.decode(b"\xc0", topic.type)


@pytest.mark.parametrize("skill", SKILLS, ids=skill_id)
def test_a_skill_is_implemented_by_its_component_with_the_same_signature(skill: Skill[..., Any]) -> None:
    component = CLASSES[skill.component]
    method = getattr(component, component.skills()[skill])
    wanted, found = inspect.signature(skill.signature), inspect.signature(method)
    own = 2 if isinstance(skill, ReportingSkill) else 1  # self, and the progress callback
    parameters = list(found.parameters.values())[own:]
    assert [(p.name, p.default) for p in parameters] == [(p.name, p.default) for p in wanted.parameters.values()]
    hints = get_type_hints(method)
    if isinstance(skill, ReportingSkill):
        assert hints.pop(list(found.parameters)[1]) == Callable[[skill.reports], None]
    assert hints == get_type_hints(skill.signature)


@pytest.mark.parametrize("skill", SKILLS, ids=skill_id)
def test_a_skill_is_documented_bounded_in_time_and_can_cross_a_process_border(skill: Skill[..., Any]) -> None:
    assert skill.doc.endswith(".")
    # A skill of the decision layer is a whole task, which has its own time budget.
    assert 0.0 < skill.timeout_s <= (7200.0 if skill.component == "decision" else 600.0)
    hints = get_type_hints(skill.signature)
    assert set(hints) == {*inspect.signature(skill.signature).parameters, "return"}
    # The inspection fails on what msgspec cannot encode.
    msgspec.inspect.multi_type_info([hint for name, hint in hints.items() if name != "return"])
    msgspec.inspect.type_info(Succeeded[hints["return"]])
    if isinstance(skill, ReportingSkill):
        msgspec.inspect.type_info(skill.reports)


@pytest.mark.parametrize("name", COMPONENTS)
def test_the_row_of_a_component_names_what_its_class_can_do_and_its_settings(name: str) -> None:
    row, component = COMPONENTS[name], CLASSES[name]
    assert set(row.skills()) == set(component.skills())
    assert {skill.component for skill in row.skills()} <= {component.name}
    assert {row.settings, *row.replays} <= {field.name for field in fields(RunConfig)}


def test_every_component_runs_in_exactly_one_process() -> None:
    placed = Counter(component for row in PROCESSES for component in row.components)
    assert placed == Counter(COMPONENTS.keys())


def test_a_process_starts_after_rows_above_it_and_the_decision_process_is_the_first() -> None:
    assert PROCESSES[0] is DECISION
    seen: set[str] = set()
    for row in PROCESSES:
        assert set(row.after) <= seen, f"{row.name} waits for a process that the table starts later"
        seen.add(row.name)


def test_the_cell_runs_only_without_hardware_and_the_viewer_only_when_watched() -> None:
    def names(run: RunConfig) -> set[str]:
        return {row.name for row in processes_of_run(run)}

    everything = names(RunConfig(arms=2))
    assert everything == {row.name for row in PROCESSES}
    pictures = RecordedCameraConfig(path="pictures")
    assert everything - names(RunConfig(arms=2, dry_run=True, camera=pictures)) == {"cell"}
    assert everything - names(RunConfig(arms=2, headless=True)) == {"viewer"}


def test_the_second_arm_has_a_component_and_a_process_where_a_run_has_one() -> None:
    for config, others in ((RunConfig(), ()), (RunConfig(arms=2), ("second",))):
        arms = config.arms
        placed = [name for row in processes_of_run(config) for name in row.components]
        assert sorted(placed) == sorted(components_of_run(config))
        assert instances_of_run(config).get("robot", ()) == others
        assert set(COMPONENTS) - set(placed) == {f"robot.{instance}" for instance in INSTANCES[arms:]}
