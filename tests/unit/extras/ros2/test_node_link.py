"""The workspace's half of the link, `ros/dlokit_ros`: it has no code in common with dlokit, and must agree with it."""

import ast
import asyncio
import dataclasses
import importlib.util
import io
import json
import os
import re
import socket
import struct
import sys
import tempfile
import threading
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dlokit.app.commands import parse
from dlokit.communication.timing import virtual_time
from dlokit.errors import DlokitError, SkillFailure
from dlokit.extras.ros2.link import frames
from dlokit.system.processes.runtime_folder import user_folder_path
from dlokit.system.processes.stop_socket import CONFIRMED_STOP, stop_button

ROS = Path(__file__).parents[4] / "ros"
PACKAGE = ROS / "dlokit_ros"
FILES = sorted(path for path in ROS.rglob("*") if path.is_file() and "__pycache__" not in path.parts)
SOURCES = [path for path in FILES if path.suffix == ".py"]
ALLOWED = {"rclpy", "diagnostic_msgs", "std_srvs", "launch", "launch_ros", "setuptools", "dlokit_ros"}
"""What a workspace has besides Python's standard library."""
MOST_LINES = 700
HANGS_S = 60.0
"""It takes milliseconds; only a failing test waits this long."""

FROM_NODE: tuple[frames.FromNode, ...] = (
    frames.Hello(version=1, distribution="jazzy", rmw="rmw_x", node="/dlokit", package="0.1", hashes={"a/msg/B": "R"}),
    frames.Time(ros_ns=-1, monotonic_ns=2**62),
    frames.Graph(
        topics={"/a": ["a/msg/B", "a/msg/C"]},
        publishers={"/a": [frames.Endpoint(node="/n", type="a/msg/B", reliable=True, transient_local=False)]},
        subscriptions={},
    ),
    frames.RosMessage(topic="/ä", type="a/msg/B", arrived_ns=3),
    frames.Lacks(topic="~/b", why='it "is" not there'),
)
TO_NODE: tuple[frames.ToNode, ...] = (
    frames.Welcome(version=1, dlokit="1.2"),
    frames.Refused(why="no"),
    frames.Beat(real_ns=1, monotonic_ns=2),
    frames.Advertise(topic="~/dlo", type="a/msg/B", transient_local=True, depth=3),
    frames.Subscribe(topic="/a", type="a/msg/B", depth=5),
    frames.Publish(topic="~/dlo"),
)
PAYLOADS = (b"", b"\x00\x01\x00\x00" + bytes(range(256)))


def load(path: Path) -> Any:
    spec = importlib.util.spec_from_file_location(f"node_{path.stem.replace('.', '_')}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


node = load(PACKAGE / "dlokit_ros" / "link.py")


def fields_of(header: Any) -> dict[str, Any]:
    """The header as the node sees it."""
    return json.loads(frames.encode(header)[8:])


async def dlokit_reads(data: bytes) -> tuple[Any, bytes]:
    reader = asyncio.StreamReader()
    reader.feed_data(data)
    reader.feed_eof()
    return await frames.read(reader)


@pytest.mark.parametrize("payload", PAYLOADS)
@pytest.mark.parametrize("header", FROM_NODE)
def test_dlokit_reads_what_the_node_writes(header: Any, payload: bytes) -> None:
    assert virtual_time.run(dlokit_reads(node.encode(fields_of(header), payload))) == (header, payload)


@pytest.mark.parametrize("payload", PAYLOADS)
@pytest.mark.parametrize("header", TO_NODE)
def test_the_node_reads_what_dlokit_writes(header: Any, payload: bytes) -> None:
    stream = io.BytesIO(frames.encode(header, payload) * 2)
    for _ in range(2):
        assert node.read(stream) == (fields_of(header), payload)
    with pytest.raises(EOFError):
        node.read(stream)


def test_the_node_knows_dlokits_frames_their_fields_and_defaults_and_both_have_the_same_limits() -> None:
    kinds = {fields_of(one)["kind"]: one for one in TO_NODE}
    assert set(kinds) == {str(kind.__struct_config__.tag) for kind in frames.ToNode.__args__}
    for kind, header in kinds.items():
        needed = {name: value for name, value in fields_of(header).items() if name != "depth"}
        read, _ = node.read(io.BytesIO(node.encode(needed)))
        defaults = {} if "depth" not in header.__struct_fields__ else {"depth": type(header).__struct_defaults__[-1]}
        assert read == {**needed, **defaults}
        for name in set(needed) - {"kind"}:
            for damaged in ({**needed, name: None}, {key: needed[key] for key in needed if key != name}):
                with pytest.raises(node.LinkError):
                    node.read(io.BytesIO(node.encode(damaged)))
        assert node.read(io.BytesIO(node.encode({**needed, "of_a_newer_dlokit": [1]})))[0]["kind"] == kind
    limits = (frames.VERSION, frames.MOST_HEADER, frames.MOST_PAYLOAD)
    assert limits == (node.VERSION, node.MOST_HEADER, node.MOST_PAYLOAD)


@given(st.binary(max_size=200) | st.builds(lambda text: struct.pack("<II", len(text), 0) + text, st.binary(min_size=1)))
def test_any_bytes_are_a_frame_or_refused_by_the_node(data: bytes) -> None:
    try:
        header, _ = node.read(io.BytesIO(data))
    except (node.LinkError, EOFError):
        return
    assert header["kind"]


@pytest.mark.parametrize(
    "header", [b"{}", b"[]", b"null", b'{"kind": []}', b'{"kind": "lacks"}', b"[" * 2**16, b"\xff\xfe{\x00}\x00"]
)
def test_the_node_refuses_a_damaged_header(header: bytes) -> None:
    with pytest.raises(node.LinkError):
        node.read(io.BytesIO(struct.pack("<II", len(header), 0) + header))


class Sizes(io.BytesIO):
    """A stream from which nothing but the sizes may be read."""

    def read(self, size: int | None = -1, /) -> bytes:
        assert size == 8
        return super().read(size)


@pytest.mark.parametrize("sizes", [(0, 0), (2**20 + 1, 0), (1, 2**26 + 1), (2**32 - 1, 2**32 - 1)])
def test_the_node_refuses_a_frame_by_its_sizes(sizes: tuple[int, int]) -> None:
    with pytest.raises(node.LinkError, match="allowed are 1048576 and 67108864"):
        node.read(Sizes(struct.pack("<II", *sizes)))


class Wire:
    """Stands for a socket; keeps what is sent."""

    def __init__(self, dies_after: int = 2**31) -> None:
        self.sent = list[bytes]()
        self.shut = False
        self._dies_after = dies_after

    def sendall(self, data: bytes) -> None:
        if len(self.sent) == self._dies_after:
            raise BrokenPipeError
        self.sent.append(data)

    def shutdown(self, how: int) -> None:
        self.shut = True


def received(number: int) -> dict[str, Any]:
    return {"kind": "received", "topic": "/a", "type": "a/msg/B", "arrived_ns": number}


def numbers_sent(outbox: Any) -> list[int]:
    wire = Wire()
    outbox.close()
    outbox.send_to(wire)
    assert wire.shut
    read = [virtual_time.run(dlokit_reads(frame))[0] for frame in wire.sent]
    return [one.arrived_ns if isinstance(one, frames.RosMessage) else -1 for one in read]


def test_a_full_outbox_drops_the_oldest_messages_counts_them_and_keeps_clocks() -> None:
    outbox = node.Outbox(most_waiting=300)
    outbox.put(received(0), bytes(100))
    outbox.put(fields_of(FROM_NODE[1]))
    for number in range(1, 6):
        outbox.put(received(number), bytes(100))
    assert outbox.dropped == 3
    assert numbers_sent(outbox) == [-1, 3, 4, 5]


def test_a_message_that_is_larger_than_a_frame_is_dropped_and_counted() -> None:
    outbox = node.Outbox()
    outbox.put(received(0), bytes(frames.MOST_PAYLOAD + 1))
    outbox.put(received(1), b"x")
    assert outbox.dropped == 1
    assert numbers_sent(outbox) == [1]


def test_a_link_that_breaks_ends_the_sending() -> None:
    outbox, wire = node.Outbox(), Wire(dies_after=1)
    for number in range(3):
        outbox.put(received(number), b"x")
    outbox.send_to(wire)
    assert wire.shut
    assert len(wire.sent) == 1


@pytest.mark.parametrize("variable", ["DLOKIT_RUNTIME_DIR", "XDG_RUNTIME_DIR", "TMPDIR"])
def test_the_node_finds_the_runtime_folder_of_dlokit(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    short = Path(tempfile.mkdtemp(dir=os.environ["DLOKIT_RUNTIME_DIR"]))
    monkeypatch.delenv("DLOKIT_RUNTIME_DIR")
    monkeypatch.setenv(variable, str(short))
    monkeypatch.setattr(tempfile, "tempdir", None)
    assert node.runtime_folder() == user_folder_path()
    assert (node.runtime_folder() == short) == (variable == "DLOKIT_RUNTIME_DIR")
    assert node.runtime_folder(str(short)) == short


def test_the_node_refuses_a_folder_that_other_users_may_enter_and_a_path_that_is_too_long() -> None:
    shared = Path(tempfile.mkdtemp(dir=os.environ["DLOKIT_RUNTIME_DIR"]))
    shared.chmod(0o755)
    with pytest.raises(node.LinkError, match="mode 700"):
        node.runtime_folder(str(shared))
    with pytest.raises(node.LinkError, match="too long"):
        node.runtime_folder("/tmp/" + "x" * 100)


def press_with(
    folder: Path, arms: dict[str, Callable[[Callable[[], str]], Awaitable[None]]], within_s: float = HANGS_S
) -> tuple[bool, str]:
    """What the node's stop returns while dlokit's robot processes serve their stop sockets."""

    async def body() -> tuple[bool, str]:
        async with AsyncExitStack() as stack:
            for name, stop in arms.items():
                await stack.enter_async_context(stop_button(folder / f"0123456789abcdef-{name}.stop", stop, stands))
            return await asyncio.to_thread(node.press_stop, folder, within_s)

    return asyncio.run(body())


async def stands(caller: object = None) -> None: ...


async def fails(caller: object) -> None:
    raise SkillFailure("not_confirmed", "no feedback")


async def hangs(caller: object) -> None:
    await asyncio.Event().wait()


@pytest.fixture
def folder() -> Path:
    return Path(tempfile.mkdtemp(dir=os.environ["DLOKIT_RUNTIME_DIR"]))


@pytest.mark.live
def test_the_nodes_stop_reaches_every_arm_and_is_confirmed_by_all(folder: Path) -> None:
    assert press_with(folder, {"left": stands, "right": stands}) == (
        True,
        f"left: {CONFIRMED_STOP}; right: {CONFIRMED_STOP}",
    )


@pytest.mark.live
def test_one_arm_that_does_not_confirm_is_named(folder: Path) -> None:
    confirmed, text = press_with(folder, {"left": stands, "right": fails})
    assert not confirmed
    assert text.startswith(f"left: {CONFIRMED_STOP}; right: ")
    assert "no feedback" in text


@pytest.mark.live
def test_an_arm_that_hangs_does_not_keep_the_others_moving(folder: Path) -> None:
    confirmed, text = press_with(folder, {"left": hangs, "right": stands}, within_s=1.0)
    assert not confirmed
    assert "left: NOT confirmed, press the arm's emergency stop" in text
    assert f"right: {CONFIRMED_STOP}" in text


@pytest.mark.live
def test_the_sockets_of_killed_processes_do_not_count(folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(folder / "0123456789abcdef-left.stop"))
    assert press_with(folder, {})[0] is False
    assert press_with(folder, {"right": stands}) == (True, f"right: {CONFIRMED_STOP}")


@pytest.mark.live
@pytest.mark.parametrize("answer", [b"", b"\n", b"[]\n", b'{"confirmed": 1, "text": "x"}\n', b'{"confirmed": true}\n'])
def test_an_answer_that_cannot_be_read_is_no_confirmation(answer: bytes, folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(folder / "0123456789abcdef-arm.stop"))
        server.listen()

        def serve() -> None:
            peer, _ = server.accept()
            with peer:
                peer.recv(100)
                peer.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        assert node.press_stop(folder, HANGS_S)[0] is False
        thread.join(HANGS_S)


def test_the_workspaces_half_is_small() -> None:
    lines = [line for path in FILES for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    assert len(lines) <= MOST_LINES


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_a_file_of_the_workspace_is_python_3_10_and_imports_what_a_workspace_has(path: Path) -> None:
    tree = ast.parse(path.read_text(encoding="utf-8"), feature_version=(3, 10))
    imported = {alias.name for one in ast.walk(tree) if isinstance(one, ast.Import) for alias in one.names}
    imported |= {one.module or "" for one in ast.walk(tree) if isinstance(one, ast.ImportFrom)}
    tops = {name.partition(".")[0] for name in imported} - set(sys.stdlib_module_names)
    assert tops <= (set() if path.name == "link.py" else ALLOWED)


def test_package_and_manifest_have_one_version_and_the_manifest_names_what_is_imported() -> None:
    manifest = (PACKAGE / "package.xml").read_text(encoding="utf-8")
    assert f"<version>{load(PACKAGE / 'dlokit_ros' / '__init__.py').__version__}</version>" in manifest
    depends = set(re.findall(r"depend>(\w+)</", manifest))
    types = set(re.findall(r"\"(\w+)/msg/", (PACKAGE / "dlokit_ros" / "bridge.py").read_text(encoding="utf-8")))
    assert depends >= types | (ALLOWED - {"launch", "setuptools", "dlokit_ros"})


@dataclasses.dataclass
class Action:
    """Stands for an action of `launch` or `launch_ros`."""

    kind: str
    named: dict[str, Any]
    name: str = ""


class LaunchConfiguration:
    def __init__(self, name: str) -> None:
        self._name = name

    def perform(self, context: dict[str, str]) -> str:
        return context[self._name]


def action(kind: str) -> Callable[..., Action]:
    return lambda *names, **named: Action(kind, named, *names)


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[str, Action]]:
    """Launch a file of the package with arguments: the actions that are started."""
    actions = ("DeclareLaunchArgument", "ExecuteProcess", "OpaqueFunction", "Shutdown")
    modules = {
        "launch": {"LaunchDescription": lambda found: found},
        "launch.actions": {kind: action(kind) for kind in actions},
        "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": action("Node")},
    }
    for name, members in modules.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    shared = load(PACKAGE / "dlokit_ros" / "launching.py")
    monkeypatch.setitem(sys.modules, "dlokit_ros", ModuleType("dlokit_ros"))
    monkeypatch.setitem(sys.modules, "dlokit_ros.launching", shared)

    def launch(file: str, **arguments: str) -> dict[str, Action]:
        described: Sequence[Action] = load(PACKAGE / "launch" / file).generate_launch_description()
        context = {one.name: one.named["default_value"] for one in described if one.kind == "DeclareLaunchArgument"}
        assert set(arguments) <= set(context)
        (start,) = (one.named["function"] for one in described if one.kind == "OpaqueFunction")
        return {one.kind: one for one in start({**context, **arguments})}

    return launch


TRACK = {"colour": "/c/image_raw", "depth": "/d/image_raw"}


@pytest.mark.parametrize(
    ("file", "arguments", "line"),
    [
        (
            "track.launch.py",
            TRACK,
            "track --camera ros2 --ros2 --camera.colour /c/image_raw --camera.depth /d/image_raw",
        ),
        (
            "track.launch.py",
            {"cloud": "/p", "arguments": "--segmentation colour"},
            "track --camera ros2 --ros2 --camera.cloud /p",
        ),
        ("demo.launch.py", {}, "shape --runtime live --ros2 --start I --goal S"),
        ("demo.launch.py", {"start": "S", "goal": "I"}, "shape --runtime live --ros2 --start S --goal I"),
    ],
)
def test_a_launch_file_starts_the_node_and_a_command_that_dlokit_understands(
    file: str, arguments: dict[str, str], line: str, launched: Callable[..., dict[str, Action]]
) -> None:
    actions = launched(file, dlokit="/opt/dlokit", link="lab", **arguments)
    command = [word for word in actions["ExecuteProcess"].named["cmd"] if word not in ("--ros2.link", "lab")]
    assert command == ["/opt/dlokit", *line.split(), *arguments.get("arguments", "").split()]
    try:
        parse(actions["ExecuteProcess"].named["cmd"][1:])
    except DlokitError as error:
        pytest.fail(f"dlokit does not understand it: {error}")
    assert actions["Node"].named["executable"] == "bridge"
    assert actions["Node"].named["parameters"] == [{"link": "lab"}]


def test_dlokit_is_launched_without_the_libraries_of_ros(
    launched: Callable[..., dict[str, Action]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", "/opt/ros/humble/lib/python3.10/site-packages")
    monkeypatch.setenv("LD_LIBRARY_PATH", "/opt/ros/humble/lib")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    environment = launched("demo.launch.py")["ExecuteProcess"].named["env"]
    assert environment["ROS_DOMAIN_ID"] == "7"
    assert environment.keys() == os.environ.keys() - {"PYTHONPATH", "LD_LIBRARY_PATH"}
