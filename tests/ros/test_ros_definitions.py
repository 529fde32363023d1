"""The message definitions that dlokit uses are those of real ROS 2, and both read what the other has written."""

import hashlib
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ros_lab import RosEnvironment, RosNetwork
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from dlokit.extras.ros2.definitions import DISTRIBUTIONS, definitions_of

TF = "tf2_msgs/msg/TFMessage"
MOST_SHOWN = 64
"""As in `lab/exchange.py`."""
TEXTS = ("", "base_link", "Knickstütze", "線")
MESSAGES = 5
"""Messages of each type, of other numbers, texts and lengths."""


@pytest.fixture
def types_in_use(ros_environment: RosEnvironment) -> list[str]:
    """Those that the node knows; without tf2_msgs where the environment has none."""
    types = ros_environment.run("bridge.TYPES")
    return [kind for kind in types if kind != TF or not ros_environment.why_not("tf2_msgs")]


@pytest.mark.smoke
def test_every_definition_in_use_has_the_hash_of_the_wheels(
    ros_environment: RosEnvironment, types_in_use: list[str]
) -> None:
    definitions = definitions_of(ros_environment.distribution)
    ours = {kind: definitions.hash_of(kind) for kind in types_in_use}
    assert ours == {kind: ros_environment.hash_of(kind) for kind in types_in_use}
    assert ours == ros_environment.run("bridge.type_hashes()")


def test_the_generated_interface_has_the_hash_that_labs_have(ros_environment: RosEnvironment, tf: None) -> None:
    # Of tf2_msgs in the distributions themselves, Jazzy and later.
    assert ros_environment.hash_of(TF) == "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"


@pytest.mark.parametrize("never_run_on", ["humble", "lyrical"])
def test_distributions_that_dlokit_was_never_run_on_have_the_definitions_of_jazzy_by_rosbags(
    ros_environment: RosEnvironment, types_in_use: list[str], never_run_on: str
) -> None:
    assert never_run_on in DISTRIBUTIONS
    theirs, jazzy = definitions_of(never_run_on), definitions_of("jazzy")
    assert {kind for kind in types_in_use if theirs.hash_of(kind) != jazzy.hash_of(kind)} == set()


@pytest.mark.smoke
def test_dlokit_and_rclpy_read_each_others_messages_field_by_field(
    lab: RosNetwork, types_in_use: list[str], tmp_path: Path
) -> None:
    definitions, reader = definitions_of(lab.environment.distribution), lab.listener()
    rng, written, again = np.random.default_rng(0), tmp_path / "written", tmp_path / "again"
    for kind in types_in_use * MESSAGES:
        message = made(definitions.distribution, kind, rng)
        written.write_bytes(definitions.encode(kind, message))
        reader.order("read", path=str(written), type=kind, again=str(again))
        assert reader.hear("read")["fields"] == told(message)
        assert told(definitions.decode(kind, again.read_bytes())) == told(message)


def made(distribution: str, kind: str, rng: np.random.Generator) -> Any:
    """A message with all its fields at random."""
    store = get_typestore(Stores(f"ros2_{distribution}"))
    values = {name: value_of(distribution, form, rng) for name, form in store.fielddefs[kind][1]}
    return definitions_of(distribution).make(kind, **values)


def value_of(distribution: str, form: Any, rng: np.random.Generator) -> Any:
    node, detail = form
    if node is Nodetype.BASE:
        return base_values(detail[0], 1, rng)[0]
    if node is Nodetype.NAME:
        return made(distribution, detail, rng)
    inner, length = detail
    if node is Nodetype.SEQUENCE:
        length = int(rng.integers(0, 4)) if inner[0] is Nodetype.NAME else int(rng.choice((0, 1, 5, 3 * MOST_SHOWN)))
    if inner[0] is Nodetype.BASE:
        return base_values(inner[1][0], length, rng)
    return [value_of(distribution, inner, rng) for _ in range(length)]


def base_values(name: str, count: int, rng: np.random.Generator) -> Any:
    if name == "string":
        return rng.choice(TEXTS, count).tolist()
    if name == "bool":
        return rng.integers(0, 2, count).astype(np.bool_)
    if name == "byte":
        return rng.integers(0, 128, count, np.uint8)  # rosbags writes no higher ones; levels of diagnostics end at 3
    kind = np.dtype(name)
    if kind.kind == "f":
        return rng.normal(size=count).astype(kind)
    limits = np.iinfo(kind)
    return rng.integers(limits.min, limits.max, count, kind, endpoint=True)


def told(value: Any) -> Any:
    """As `lab/exchange.py` tells a message."""
    if is_dataclass(value):
        # A constant of the definition is a field with a default.
        return {field.name: told(getattr(value, field.name)) for field in fields(value) if field.default is MISSING}
    if isinstance(value, list):
        return [told(one) for one in value]
    if isinstance(value, np.ndarray) and value.size > MOST_SHOWN:
        return {"length": value.size, "sha256": hashlib.sha256(value.tobytes()).hexdigest()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value
