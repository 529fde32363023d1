"""Definitions are those of the distributions; damaged frames and messages are refused within bounds."""

import asyncio
import importlib
import tracemalloc
from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
import pytest
import ros2_messages as ros
from hypothesis import given, settings
from hypothesis import strategies as st
from message_damage import mutated

from dlokit.errors import CommunicationError, ConfigError, MachineError
from dlokit.extras.ros2.definitions import DISTRIBUTIONS, definitions_of
from dlokit.extras.ros2.link import frames
from dlokit.geometry import pose
from dlokit.geometry.camera import centred_camera

HASHES = {
    "diagnostic_msgs/msg/DiagnosticArray": "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    "diagnostic_msgs/msg/DiagnosticStatus": "b0e3e692ea2d54a8af2f4ef1930e81556a2db55216b771f8a7d2724ed47bf0e4",
    "geometry_msgs/msg/PoseArray": "af0cc36d190e104d546d168d6b39df04fa4b4ccecf59cb4c9ed328d3d5004aa0",
    "geometry_msgs/msg/TransformStamped": "0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206",
    "nav_msgs/msg/Path": "1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b",
    "sensor_msgs/msg/CameraInfo": "b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
    "sensor_msgs/msg/CompressedImage": "15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
    "sensor_msgs/msg/Image": "d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
    "sensor_msgs/msg/JointState": "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    "sensor_msgs/msg/PointCloud2": "9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5",
    "std_msgs/msg/Header": "f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
    "visualization_msgs/msg/MarkerArray": "86cb8800b6fb05b5eff1abd7a56f62a5641d3ae9a1c29e78e67e704f1d067dcf",
}
"""Type hashes (RIHS01) in the type descriptions of the wheels ros-jazzy-* 5.3.6 and ros-kilted-* 5.5.1 (equal). They
have no tf2_msgs, whose one definition in use is an array of TransformStamped."""

CAMERA = centred_camera(8, 6, 10.0, pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)))
POINTS = np.ones((2, 3, 3), dtype=np.float32)
MESSAGES: dict[str, Any] = {
    "Image": ros.image(np.zeros((6, 8, 3), dtype=np.uint8), "rgb8"),
    "CompressedImage": ros.compressed(b"some bytes", "jpeg"),
    "CameraInfo": ros.info(CAMERA),
    "PointCloud2": ros.cloud(POINTS, POINTS.astype(np.uint8)),
    "TFMessage": ros.tf(("a", "b", pose((0.0, 0.0, 0.0))), ("b", "c", pose((0.0, 0.0, 1.0)))),
}
FRAMES: tuple[tuple[frames.FromNode | frames.ToNode, bytes], ...] = (
    (frames.Hello(version=1, distribution="jazzy", rmw="r", node="/dlokit", package="1", hashes={"a": "b"}), b""),
    (frames.Graph(topics={"/a": ["b"]}, publishers={}, subscriptions={}), b""),
    (frames.RosMessage(topic="/a", type="b", arrived_ns=3), b"payload" * 100),
    (frames.Beat(real_ns=1, monotonic_ns=2), b""),
)
ALLOWED_BYTES = 2_000_000
"""Memory for a frame or message of a few kilobytes; sizes that damage announces are up to 4 GB."""
every_time_the_same = settings(max_examples=150, deadline=None, derandomize=True, database=None)


def within_bounds(decode: Callable[[], object], *refusals: type[Exception]) -> bool:
    """Whether something is decoded, and not refused; other exceptions and more memory fail."""
    tracemalloc.start()
    try:
        decode()
    except refusals:
        return False
    finally:
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert most < ALLOWED_BYTES
    return True


def read(data: bytes) -> tuple[frames.FromNode | frames.ToNode, bytes]:
    async def main() -> tuple[frames.FromNode | frames.ToNode, bytes]:
        reader = asyncio.StreamReader()
        reader.feed_data(data)
        reader.feed_eof()
        return await frames.read(reader)

    return asyncio.run(main())


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_definitions_have_the_hashes_of_the_distribution(distribution: str) -> None:
    definitions = definitions_of(distribution)
    assert {kind: definitions.hash_of(kind).removeprefix("RIHS01_") for kind in HASHES} == HASHES


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
def test_definitions_of_pictures_and_transforms_are_equal_in_all_distributions(distribution: str) -> None:
    # A bag that names no distribution is read with those of jazzy.
    kinds = (ros.IMAGE, ros.COMPRESSED, ros.INFO, ros.CLOUD, ros.TF)
    assert all(definitions_of(distribution).hash_of(kind) == ros.DEFINITIONS.hash_of(kind) for kind in kinds)


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES.keys())
def test_a_message_is_decoded_as_encoded(message: Any) -> None:
    kind = message.__msgtype__
    assert ros.cdr(ros.DEFINITIONS.decode(kind, ros.cdr(message))) == ros.cdr(message)


@pytest.mark.parametrize("message", MESSAGES.values(), ids=MESSAGES.keys())
@every_time_the_same
@given(seed=st.integers(0, 2**32 - 1))
def test_a_damaged_message_is_decoded_or_refused_within_bounds(message: Any, seed: int) -> None:
    data = mutated(ros.cdr(message), Random(seed))
    within_bounds(lambda: ros.DEFINITIONS.decode(message.__msgtype__, data), CommunicationError)


@every_time_the_same
@given(seed=st.integers(0, 2**32 - 1), which=st.integers(0, len(FRAMES) - 1))
def test_a_damaged_frame_is_read_or_refused_within_bounds(seed: int, which: int) -> None:
    data = mutated(frames.encode(*FRAMES[which]), Random(seed))
    within_bounds(lambda: read(data), CommunicationError, EOFError)


@every_time_the_same
@given(data=st.binary(max_size=200))
def test_garbage_is_no_frame(data: bytes) -> None:
    assert not within_bounds(lambda: read(data), CommunicationError, EOFError)


@pytest.mark.parametrize(
    "header", [b'{"kind": "beat", "x": ' + b"[" * 100_000, b'{"kind": "\xbb"}'], ids=["nested", "no text"]
)
def test_a_header_that_is_no_json_is_refused(header: bytes) -> None:
    with pytest.raises(CommunicationError, match="header cannot be read"):
        read(len(header).to_bytes(4, "little") + bytes(4) + header)


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: type(frame[0]).__name__)
def test_a_frame_is_read_as_written_and_a_part_of_it_is_the_end(
    frame: tuple[frames.FromNode | frames.ToNode, bytes],
) -> None:
    data = frames.encode(*frame)
    assert read(data) == frame
    for cut in range(0, len(data), 7):
        with pytest.raises(EOFError):
            read(data[:cut])


def test_some_damage_is_refused_and_some_is_not() -> None:
    # Otherwise the damage was absent, or too strong.
    rng = Random(1)
    messages = [
        within_bounds(
            lambda one=one: ros.DEFINITIONS.decode(one.__msgtype__, mutated(ros.cdr(one), rng)), CommunicationError
        )
        for one in MESSAGES.values()
        for _ in range(20)
    ]
    read_frames = [
        within_bounds(lambda one=one: read(mutated(frames.encode(*one), rng)), CommunicationError, EOFError)
        for one in FRAMES
        for _ in range(20)
    ]
    assert 0.0 < np.mean(messages) < 0.9
    assert 0.0 < np.mean(read_frames) < 0.9


def test_a_definition_agrees_with_its_own_text_alone() -> None:
    text = ros.DEFINITIONS.text_of(ros.INFO)
    assert ros.DEFINITIONS.agrees(ros.INFO, text)
    assert not ros.DEFINITIONS.agrees(ros.INFO, text.replace("float64[9] k", "float32[9] k"))
    with pytest.raises(CommunicationError, match="cannot be read"):
        ros.DEFINITIONS.agrees(ros.INFO, "import os; os.system('true')")


def test_another_distribution_is_refused() -> None:
    with pytest.raises(ConfigError, match="'rolling' is not known; known are humble, jazzy, kilted, lyrical"):
        definitions_of("rolling")


def test_a_machine_without_rosbags_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(module: str) -> Any:
        raise ModuleNotFoundError(name=module)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(MachineError, match=r"needs rosbags, which is not installed: .*\[ros2\]"):
        definitions_of.__wrapped__("jazzy")
