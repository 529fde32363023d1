"""Shape servoing in the flow chart: the remaining error is corrected while the rope is held."""

from dataclasses import replace

import pytest
from ideal_lab import EASY, I, lab, shape
from scripted_hardware import Lab

from dlokit.decision.config import TaskConfig
from dlokit.decision.steps import control
from dlokit.description.shapes import moved
from dlokit.skills.planning.config import PlanningConfig
from dlokit.skills.planning.farthest import FarthestConfig
from dlokit.types.flow import FlowStatus, Mode

SERVO = TaskConfig(control=True, max_actions=1, threshold_m=0.004)


def feeling_lab() -> Lab:
    felt = lab(I)
    felt.feels = True  # control continues only while the fingers detect an object
    return felt


def test_control_corrects_while_the_rope_is_held_and_then_releases() -> None:
    trace = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO)
    assert ("move_to_goal", "to_control", "control") in trace.edges()
    assert ("control", "corrected", "control") in trace.edges()
    assert ("control", "settled", "release") in trace.edges()
    [record] = trace.result.history
    assert record.corrections
    first = record.corrections[0]
    assert first.predicted_m < first.before_m
    assert first.seen_m is not None


def test_control_does_not_follow_if_its_gain_is_within_the_observers_uncertainty() -> None:
    blurred = PlanningConfig(strategy=FarthestConfig(), servo=replace(EASY, sight_m=0.1))
    trace = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO, planning=blurred)
    assert ("move_to_goal", "done", "release") in trace.edges()
    [record] = trace.result.history
    assert record.control_end == "not_worth_it"
    without = shape(feeling_lab(), moved(I, (0.04, 0.03)), replace(SERVO, control=False))
    assert trace.steps == without.steps
    assert (record.nodes_world == without.result.history[0].nodes_world).all()


def test_the_mode_planning_or_control_is_published() -> None:
    told: dict[str, Mode | None] = {}

    def watch(status: FlowStatus) -> None:
        told[status.step] = status.mode

    shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO, operator=watch)
    assert told["choose_grasp"] is told["move_to_goal"] is Mode.PLANNING
    assert told["control"] is Mode.CONTROL
    assert told["track_again"] is None


def test_corrections_of_one_grasp_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "MOST_CORRECTIONS", 1)
    trace = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO)
    [record] = trace.result.history
    assert len(record.corrections) == 1
    assert record.control_end in ("corrections_spent", "no_gain", "good_enough")


def test_a_correction_that_the_robot_refuses_is_a_deadlock_and_marks_the_grasp() -> None:
    refusing = feeling_lab()
    refusing.fails["move_linear"] = ["", "unreachable"]  # down to the grasp, then the first correction
    trace = shape(refusing, moved(I, (0.04, 0.03)), replace(SERVO, max_actions=2, threshold_m=0.001, infeasible="try"))
    assert ("control", "deadlock", "release") in trace.edges()
    first, second = trace.result.history
    assert (first.control_end, first.ended_by) == ("out_of_reach", None)
    assert first.grasp_node != second.grasp_node


def test_an_arm_that_brakes_in_a_correction_is_recovered_and_releases() -> None:
    late = feeling_lab()
    late.fails["move_linear"] = ["", "lost_commander"]
    trace = shape(late, moved(I, (0.04, 0.03)), SERVO)
    assert ("control", "interrupted", "recover") in trace.edges()
    assert ("recover", "done", "release") in trace.edges()
    assert [record.ended_by for record in trace.result.history] == ["lost_commander"]


def test_an_arm_lost_in_a_correction_fails_the_task() -> None:
    broken = feeling_lab()
    broken.fails["move_linear"] = ["", "robot_lost"]
    assert ("control", "failed", "failed") in shape(broken, moved(I, (0.04, 0.03)), SERVO).edges()


def test_a_rope_that_is_not_seen_while_held_is_released_without_correction() -> None:
    blind = feeling_lab()
    looks_before = shape(feeling_lab(), moved(I, (0.04, 0.03)), SERVO).calls
    before = looks_before[: looks_before.index("follow_path")].count("look")
    blind.fails["look"] = [""] * before + ["no_points"]
    trace = shape(blind, moved(I, (0.04, 0.03)), SERVO)
    assert ("control", "settled", "release") in trace.edges()
    [record] = trace.result.history
    assert record.control_end == "not_seen"
    assert record.corrections == ()
