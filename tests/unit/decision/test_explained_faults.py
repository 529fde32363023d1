"""The reason of a task that a person has stopped begins with who it was."""

from dlokit.decision.faults import explain
from dlokit.types.outcome import Failed


def test_a_stop_names_the_process_of_the_person_or_the_skill() -> None:
    named = Failed(reason="stopped", detail="by process 4711 (dlokit stop): the arm was braked")
    assert explain(named) == "stopped by process 4711 (dlokit stop): the arm was braked"
    unnamed = Failed(reason="stopped", detail="the arm was braked")
    assert explain(unnamed) == "stopped by robot.stop: the arm was braked"
