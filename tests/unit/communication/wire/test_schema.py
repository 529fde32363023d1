import enum
from typing import Annotated, Any

import msgspec
import pytest

from dlokit.communication.topics import TOPICS
from dlokit.communication.wire.schema import description, fingerprint, is_listing
from dlokit.types.arrays import Float32Array, Float64Array
from dlokit.types.message import Value


class Colour(enum.Enum):
    RED = "red"


class Hue(enum.Enum):
    RED = "red"
    BLUE = "blue"


class Paint(Value, frozen=True, kw_only=True, eq=False):
    colour: Colour
    weight_kg: float
    spots: Float64Array
    name: str = "plain"


class Tree(msgspec.Struct):
    size: int
    left: "Tree | None" = None


class Bush(msgspec.Struct):
    size: int
    left: "Bush | None" = None


def paint(**changed: Any) -> type[msgspec.Struct]:
    fields: dict[str, Any] = {"colour": Colour, "weight_kg": float, "spots": Float64Array, "name": (str, "plain")}
    fields.update(changed)
    listed = [(name, *kind) if isinstance(kind, tuple) else (name, kind) for name, kind in fields.items() if kind]
    return msgspec.defstruct("Paint", listed, bases=(Value,), kw_only=True, frozen=True, eq=False)


def test_the_fingerprint_does_not_depend_on_the_class_name() -> None:
    assert fingerprint(paint()) == fingerprint(Paint)
    assert fingerprint(Tree) == fingerprint(Bush)


def test_the_fingerprint_does_not_depend_on_defaults() -> None:
    assert fingerprint(paint(name=(str, "striped"))) == fingerprint(Paint)


@pytest.mark.parametrize(
    "changed",
    [
        {"weight_kg": None},
        {"weight_kg": None, "weight_g": float},
        {"weight_kg": int},
        {"weight_kg": float | None},
        {"weight_kg": Annotated[float, msgspec.Meta(ge=0)]},
        {"weight_kg": (float, 1.0)},
        {"colour": Hue},
        {"spots": Float32Array},
        {"thickness_m": float},
        {"name": (tuple[str, ...], ())},
    ],
    ids=str,
)
def test_every_change_of_a_field_changes_the_fingerprint(changed: dict[str, Any]) -> None:
    assert fingerprint(paint(**changed)) != fingerprint(Paint)


def test_the_fingerprint_is_the_same_in_every_process() -> None:
    # A literal: an address or a hash that differs between processes would make them incompatible.
    assert fingerprint(Tree).hex() == "b6e86b2a04adb19c"


def test_every_topic_has_a_description_without_addresses() -> None:
    for topic in TOPICS:
        assert " at 0x" not in description(topic.type)


@pytest.mark.parametrize(
    ("wanted", "listing"),
    [
        (Paint, False),
        (Tree, False),
        (tuple[int, int], False),
        (tuple[int, ...], True),
        (list[Paint], True),
        (dict[str, int], True),
        (paint(name=tuple[Paint, ...] | None), True),
        (tuple[int, list[int]], True),
        (Any, True),
    ],
    ids=str,
)
def test_a_type_with_any_number_of_items_is_detected(wanted: Any, listing: bool) -> None:
    assert is_listing(wanted) is listing
