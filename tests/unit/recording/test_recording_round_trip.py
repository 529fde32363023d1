"""Recorded messages are read back unchanged, from files that Foxglove can read."""

import enum
from pathlib import Path
from typing import Any, get_args

import msgspec
import numpy as np
import pytest
from example_messages import EXAMPLES
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.reader import make_reader
from mcap.records import Schema

from dlokit.communication.topics import DEPTH_IMAGES, STEREO_IMAGES, TOPICS
from dlokit.errors import CommunicationError
from dlokit.recording.channels import CALLS, CALLS_BEGUN, recorded_topics
from dlokit.recording.message_json import from_json, json_schema, kind_name, to_json
from dlokit.recording.reader import read_recording
from dlokit.recording.views import VIEWS, from_png, to_jpeg, to_png
from dlokit.recording.writer import RecordingWriter
from dlokit.types.action import Action, PairPlace, Partner
from dlokit.types.image import DepthImage
from dlokit.types.message import Message
from dlokit.types.outcome import CallBegun
from dlokit.types.robot import RobotState
from dlokit.types.system import ClockTick

PICTURES = (STEREO_IMAGES.name, DEPTH_IMAGES.name)
JPEG_ERROR = 4  # of 255, for an image of one colour


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One message of every channel."""
    path = tmp_path_factory.mktemp("recording") / "all.mcap"
    writer = RecordingWriter(path, {"run": {"name": "I to S"}})
    for number, (name, message) in enumerate(EXAMPLES.items()):
        writer.add(recorded_topics()[name], number, message)
    writer.close()
    return path


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other, strict=True)
    elif isinstance(one, msgspec.Struct):
        for name in one.__struct_fields__:
            assert_same(getattr(one, name), getattr(other, name))
    elif isinstance(one, tuple):
        assert len(one) == len(other)
        for mine, theirs in zip(one, other, strict=True):
            assert_same(mine, theirs)
    else:
        assert one == other or (one != one and other != other)


def test_the_topics_of_the_table_and_the_skill_calls_are_recorded_and_nothing_else() -> None:
    # The cell's true shape is on no topic of the table: tests/architecture/test_tables.py.
    assert set(recorded_topics()) == {topic.name for topic in (*TOPICS, *CALLS)}
    assert set(EXAMPLES) == set(recorded_topics())


@pytest.mark.parametrize("name", [name for name in EXAMPLES if name not in PICTURES])
def test_a_message_is_read_back_unchanged(name: str) -> None:
    assert_same(EXAMPLES[name], from_json(to_json(EXAMPLES[name]), recorded_topics()[name].type))


def test_a_file_has_every_message_in_order_with_its_time_of_arrival(recording: Path) -> None:
    back = list(read_recording(recording))
    assert [one.topic for one in back] == list(EXAMPLES)
    assert [one.log_ns for one in back] == list(range(len(EXAMPLES)))
    for one in back:
        if one.topic not in PICTURES:
            assert_same(EXAMPLES[one.topic], one.message)


def test_images_are_read_back_with_jpeg_quality_and_the_rest_unchanged(recording: Path) -> None:
    (pair,) = [one.message for one in read_recording(recording) if one.topic == STEREO_IMAGES.name]
    sent: Any = EXAMPLES[STEREO_IMAGES.name]
    for side in ("left", "right"):
        difference = getattr(pair, side).astype(int) - getattr(sent, side)
        assert np.abs(difference).max() <= JPEG_ERROR
        pair = msgspec.structs.replace(pair, **{side: getattr(sent, side)})
    assert_same(sent, pair)


def test_depths_are_read_back_to_the_millimetre_and_their_picture_with_jpeg_quality(recording: Path) -> None:
    (image,) = [one.message for one in read_recording(recording) if one.topic == DEPTH_IMAGES.name]
    sent = EXAMPLES[DEPTH_IMAGES.name]
    assert isinstance(sent, DepthImage)
    assert isinstance(image, DepthImage)
    assert np.abs(image.pixels.astype(int) - sent.pixels).max() <= JPEG_ERROR
    assert_same(sent, msgspec.structs.replace(image, pixels=sent.pixels))


def test_a_depth_that_16_bits_of_millimetres_cannot_hold_is_unknown() -> None:
    depth_m = np.array([[0.0004, 65.535, 65.6]], dtype=np.float32)
    np.testing.assert_array_equal(from_png(to_png(depth_m)), np.array([[0.0, 65.535, 0.0]], dtype=np.float32))
    with pytest.raises(CommunicationError, match="16 bits"):
        from_png(to_jpeg(np.zeros((8, 8, 3), dtype=np.uint8)))


def test_every_channel_has_a_schema_that_foxglove_reads_and_its_messages_have_its_fields(recording: Path) -> None:
    seen: set[str] = set()
    with recording.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            assert schema is not None
            seen.add(channel.topic)
            if channel.topic in VIEWS:
                assert (channel.message_encoding, schema.encoding) == ("protobuf", "protobuf")
                assert schema.name == f"foxglove.{VIEWS[channel.topic].__name__}"
                check_described(schema, message.data)
            else:
                assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
                check_readable(msgspec.json.decode(schema.data), msgspec.json.decode(message.data))
                assert schema.name == f"dlokit.{kind_name(recorded_topics()[channel.topic].type)}"
    assert seen == set(VIEWS) | set(recorded_topics())


def check_described(schema: Schema, data: bytes) -> None:
    """The schema in the file suffices to read a message completely."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)  # fails if a file precedes one that it depends on
    message = GetMessageClass(pool.FindMessageTypeByName(schema.name))()
    message.ParseFromString(data)
    assert message.ByteSize() == len(data) > 0
    assert len(UnknownFieldSet(message)) == 0
    assert message.ListFields()[0][0].name in ("timestamp", "entities")


def check_readable(schema: dict[str, Any], value: Any) -> None:
    """Foxglove takes objects of primitives, of objects, and of arrays of either; no unions, no arrays of arrays."""
    if value is None:
        return
    match schema["type"]:
        case "object":
            assert set(value) == set(schema["properties"])
            for name, part in schema["properties"].items():
                check_readable(part, value[name])
        case "array":
            assert schema["items"]["type"] != "array"
            for item in value:
                check_readable(schema["items"], item)
        case primitive:
            python = {"boolean": bool, "integer": int, "number": float | int | str, "string": str}
            assert isinstance(value, python[primitive])


def test_nan_and_infinity_survive_json() -> None:
    text = to_json(EXAMPLES["cell/clock"])
    assert b'"Infinity"' in text
    assert from_json(text, ClockTick).real_time_factor == float("inf")


@pytest.mark.parametrize(
    ("array", "match"),
    [
        ({"dtype": "<f4", "shape": [1], "values": [1.0], "base64": ""}, "array of float64 is expected"),
        ({"dtype": "O", "shape": [1], "values": [1.0], "base64": ""}, "refused; allowed"),
        ({"dtype": "<f8", "shape": [2], "values": [1.0], "base64": ""}, "cannot reshape"),
        ({"dtype": "<f8", "shape": [1], "values": [], "base64": "AAAA"}, "cannot decode"),
        ({"dtype": "<f8"}, "cannot decode"),
    ],
)
def test_an_invalid_array_is_refused(array: dict[str, Any], match: str) -> None:
    plain = msgspec.json.decode(to_json(EXAMPLES["robot/state"])) | {"q_rad": array}
    with pytest.raises(CommunicationError, match=match):
        from_json(msgspec.json.encode(plain), RobotState)


def test_every_kind_of_action_is_read_back_with_its_kind() -> None:
    picked: Any = EXAMPLES["planning/action"]
    fields = {name: getattr(picked, name) for name in picked.__struct_fields__}
    recorded = recorded_topics()["planning/action"].type
    for kind in get_args(Action):
        assert_same(kind(**fields), from_json(to_json(kind(**fields)), recorded))
    partner = Partner(robot="second", grasp=picked.grasp, path=picked.path, velocity=picked.velocity)
    paired: dict[str, Any] = {**fields, "partner": partner}
    pair = PairPlace(**paired)
    assert_same(pair, from_json(to_json(pair), recorded))
    assert kind_name(recorded).startswith("PickPlace|Drag|LayDown|Push|PairPlace")


def test_a_type_without_a_json_schema_is_refused() -> None:
    class Either(Message, frozen=True, kw_only=True, eq=False):
        value: int | str

    with pytest.raises(CommunicationError, match="no common schema"):
        json_schema(Either)


def test_missing_sequence_numbers_are_counted(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "gaps.mcap", {})
    for seq in (4, 5, 8, 1, 2):  # the publisher was started again after 8
        writer.add(recorded_topics()["cell/clock"], seq, ClockTick(stamp_ns=seq, seq=seq))
    writer.close()
    assert writer.lost == {"cell/clock": 2}


def test_calls_are_numbered_by_caller_and_alternating_callers_lose_none(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "calls.mcap", {})
    for seq, caller in ((7, "one"), (1, "other"), (8, "one"), (4, "other")):
        writer.add(CALLS_BEGUN, seq, CallBegun(stamp_ns=0, seq=seq, skill="robot.stop", call=seq, caller=caller))
    writer.close()
    assert writer.lost == {CALLS_BEGUN.name: 2}  # the other's second and third


def test_an_enumeration_is_written_by_its_value() -> None:
    class Colour(enum.Enum):
        RED = "red"

    assert to_json(Colour.RED) == b'"red"'
