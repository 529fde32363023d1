"""Deviations of two messages: per field, in its unit, and infinite if they cannot be compared."""

import math
from typing import Any

import msgspec
import numpy as np
import pytest
from example_messages import EXAMPLES

from dlokit.recording.comparison import deviations
from dlokit.recording.message_json import from_json, to_json
from dlokit.types.action import Marks


def largest(recorded: Any, replayed: Any) -> dict[str, float]:
    found: dict[str, float] = {}
    for field, apart in deviations(recorded, replayed):
        found[field] = max(apart, found.get(field, 0.0))
    return found


def changed(name: str, **fields: Any) -> dict[str, float]:
    """Deviations of a message from one with other `fields`."""
    message = EXAMPLES[name]
    found = largest(message, msgspec.structs.replace(message, **fields))
    return {field: apart for field, apart in found.items() if apart}


@pytest.mark.parametrize("name", EXAMPLES)
def test_a_message_does_not_deviate_from_its_copy_even_with_nan(name: str) -> None:
    message = EXAMPLES[name]
    found = largest(message, from_json(to_json(message), type(message)))
    assert set(found.values()) == {0.0}
    assert len(found) >= len(message.__struct_fields__) - 1


def test_numbers_and_arrays_deviate_by_their_largest_difference_in_the_fields_unit() -> None:
    state: Any = EXAMPLES["model/state"]
    moved = state.nodes_world.copy()
    moved[7, 2] += 0.25
    assert changed("model/state", nodes_world=moved, health=0.75) == {
        "nodes_world": pytest.approx(0.25),
        "health": 0.25,
    }
    assert changed("robot/state", finger_width_m=0.05) == {"finger_width_m": pytest.approx(0.01)}


def test_boolean_arrays_deviate_by_the_number_of_differences() -> None:
    targets: Any = EXAMPLES["observer/targets"]
    visible = targets.visible.copy()
    visible[[3, 9]] ^= True
    assert changed("observer/targets", visible=visible) == {"visible": 2.0}


def test_clouds_are_compared_without_order_and_by_a_quantile() -> None:
    points = np.random.default_rng(1).uniform(size=(1000, 3)).astype(np.float32)
    seen = msgspec.structs.replace(EXAMPLES["perception/cloud"], points_world=points)
    shuffled = points[::-1].copy()
    shuffled[0] += 10.0  # one outlier of a thousand
    assert largest(seen, msgspec.structs.replace(seen, points_world=shuffled))["points_world"] == 0.0
    away = points + np.array([0.0, 0.0, 2.0], dtype=np.float32)
    assert largest(seen, msgspec.structs.replace(seen, points_world=away))["points_world"] > 1.0
    assert largest(seen, msgspec.structs.replace(seen, points_world=points[:0]))["points_world"] == math.inf
    noise, other = (msgspec.structs.replace(seen, points_world=points[of]) for of in (slice(0, 6), slice(6, 15)))
    assert largest(noise, other)["points_world"] == 0.0  # no observer uses so few points
    enough = msgspec.structs.replace(seen, points_world=points[6:16])
    assert largest(noise, enough)["points_world"] > 0.0


@pytest.mark.parametrize(
    ("name", "fields", "field"),
    [
        ("model/state", {"nodes_world": np.zeros((30, 3))}, "nodes_world"),
        ("model/state", {"visible": np.ones(3, dtype=bool)}, "visible"),
        ("decision/gripped", {"node": 4}, "node"),
        ("planning/verdict", {"findings": ()}, "findings"),
        ("decision/flow", {"text": "else"}, "text"),
        ("robot/state", {"holding": True}, "holding"),
        ("robot/state", {"tau_nm": np.zeros(7)}, "tau_nm"),  # NaN and infinity on one side only
    ],
)
def test_values_that_cannot_be_compared_deviate_infinitely(name: str, fields: dict[str, Any], field: str) -> None:
    assert changed(name, **fields) == {field: math.inf}


def test_an_empty_array_is_equal_to_another() -> None:
    marks = Marks(invalid_nodes=np.empty(0, dtype=np.int64))
    assert largest(marks, marks) == {"invalid_nodes": 0.0}


def test_a_memory_is_compared_array_by_array_and_by_its_names() -> None:
    one = {"velocity": np.array([0.0, 1.0]), "weights": np.zeros(2)}
    other = {"velocity": np.array([0.0, 1.5]), "weights": np.zeros(2)}
    assert dict(deviations(one, other, "memory")) == {"memory.velocity": 0.5, "memory.weights": 0.0}
    assert dict(deviations(one, {"velocity": np.zeros(2)}, "memory")) == {"memory": math.inf}
