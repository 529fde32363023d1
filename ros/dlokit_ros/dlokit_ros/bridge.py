"""The node `dlokit`: it carries ROS messages, as bytes, between a ROS 2 graph and dlokit."""

import argparse
import contextlib
import importlib
import importlib.metadata
import json
import os
import queue
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import get_rmw_implementation_identifier, remove_ros_args
from std_srvs.srv import Trigger

from dlokit_ros import __version__, link

TYPES = (
    "builtin_interfaces/msg/Time",
    "std_msgs/msg/Header",
    *(f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "CameraInfo", "PointCloud2", "JointState")),
    *(f"geometry_msgs/msg/{name}" for name in ("PoseArray", "TransformStamped")),
    *(f"visualization_msgs/msg/{name}" for name in ("Marker", "MarkerArray")),
    *(f"diagnostic_msgs/msg/{name}" for name in ("DiagnosticStatus", "DiagnosticArray")),
    *("nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage"),
)
"""Types that dlokit encodes or decodes."""
RETRY_S, REFUSED_RETRY_S = 0.2, 5.0
MOST_FRAMES = 100  # that wait for the executor
DIAGNOSTICS = {"kind": "advertise", "topic": "/diagnostics", "type": TYPES[-3], "transient_local": False, "depth": 1}
USAGE = """bridge [--ros-args -p link:=NAME -p runtime_dir:=FOLDER]
  link: name of the link, as dlokit's --ros2.link (dlokit)
  runtime_dir: dlokit's folder of sockets (DLOKIT_RUNTIME_DIR, or the folder that dlokit chooses without it)"""


def message_class(type_: str) -> Any:
    """The class of a message type such as ``sensor_msgs/msg/Image``. Raises `LookupError` if it is not installed."""
    if not (parts := re.fullmatch(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)", type_)):
        raise LookupError(f"{type_!r} is not a message type such as sensor_msgs/msg/Image")
    try:
        return getattr(importlib.import_module(f"{parts[1]}.msg"), parts[2])
    except (ImportError, AttributeError) as error:
        raise LookupError(f"the type {type_} is not installed in the node's workspace: {error}") from error


def distribution() -> str:
    """Name of the ROS 2 distribution: ROS_DISTRO, or that of rclpy's wheel; empty if neither says it."""
    names = (re.fullmatch(r"ros-(\w+)-rclpy", one.metadata["Name"] or "") for one in importlib.metadata.distributions())
    return os.environ.get("ROS_DISTRO") or next((name[1] for name in names if name), "")


def type_hashes() -> dict[str, str]:
    """Hashes of the types whose packages have type descriptions; Humble's have none."""
    hashes: dict[str, str] = {}
    for type_ in TYPES:
        package, _, name = type_.split("/")
        with contextlib.suppress(ImportError, OSError, ValueError, LookupError):
            module = Path(importlib.import_module(package).__file__ or "")
            places = [prefix / "share" / package / "msg" / f"{name}.json" for prefix in module.parents]
            described = json.loads(next(filter(Path.exists, places), places[0]).read_text(encoding="utf-8"))
            hashes[type_] = {one["type_name"]: one["hash_string"] for one in described["type_hashes"]}[type_]
    return hashes


def endpoint(info: Any) -> dict[str, Any]:
    """A publisher or subscription, as dlokit hears of it."""
    return {
        "node": f"{info.node_namespace.rstrip('/')}/{info.node_name}",
        "type": info.topic_type,
        "hash": str(getattr(info, "topic_type_hash", "")),
        "reliable": info.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
        "transient_local": info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
    }


def profile_for(publishers: list[dict[str, Any]], depth: int) -> QoSProfile:
    """The profile with which a subscription hears all of these publishers, or with which one like them publishes."""
    reliable = all(one["reliable"] for one in publishers)
    lasting = all(one["transient_local"] for one in publishers)
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if lasting else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=depth, reliability=reliability, durability=durability)


class Bridge(Node):
    """The node. Its executor does all that concerns ROS; one thread reads the link, another one writes to it.

    Neither the executor nor the stop ever waits for the link.
    """

    def __init__(self) -> None:
        """Raises `LinkError` for a bad name of the link."""
        super().__init__("dlokit")
        self._name = self.declare_parameter("link", "dlokit").value
        self._folder = self.declare_parameter("runtime_dir", "").value
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self._name):
            raise link.LinkError(f"the parameter link is {self._name!r}; it must be letters, digits, - and _.")
        self._advertised: dict[str, tuple[dict[str, Any], Any]] = {}
        self._wanted: dict[str, dict[str, Any]] = {}
        self._heard: dict[str, tuple[QoSProfile, Any]] = {}
        self._outbox: link.Outbox | None = None
        self._said, self._dropped, self._was_connected = "", 0, False
        self._frames: queue.Queue[tuple[dict[str, Any], Any]] = queue.Queue(MOST_FRAMES)
        self._wake = self.create_guard_condition(self._work)
        self.create_timer(1.0, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))  # simulated time may stand
        self._ending = threading.Event()
        self._connection = socket.socket(socket.AF_UNIX)
        # With an executor of its own: where an arm's process hangs, a stop takes seconds, while messages go on.
        own = {"namespace": self.get_namespace(), "use_global_arguments": False, "start_parameter_services": False}
        self._stopper = rclpy.create_node(f"{self.get_name()}_stop", **own)
        self._stopper.create_service(Trigger, f"{self.get_fully_qualified_name()}/stop", self._stop)
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._keep_link, self._keep_stop)]
        for thread in self._threads:
            thread.start()

    def end(self) -> None:
        """End the threads, after ROS was shut down."""
        self._ending.set()
        link.shut(self._connection)
        for thread in self._threads:
            thread.join(2.0)

    def _keep_stop(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._stopper)
        while rclpy.ok():
            try:
                executor.spin_once(timeout_sec=0.2)
            except Exception as error:  # the stop outlives it; at the end there always is one
                if rclpy.ok():
                    self.get_logger().error(f"stop: {error}")

    def _stop(self, _: Any, response: Any) -> Any:
        try:
            response.success, response.message = link.press_stop(link.runtime_folder(self._folder))
        except Exception as error:  # the caller must hear of it, whatever it is
            response.message = f"NOT stopped, press the arm's emergency stop: {error}"
        self.get_logger().warning(f"stop: {response.message}")
        return response

    def _tick(self) -> None:
        publishers = {topic: self._try(self._look, header) for topic, header in list(self._wanted.items())}
        if not (outbox := self._outbox):
            self._publish_not_connected()
            return
        if outbox.dropped > self._dropped:
            self.get_logger().warning(f"dlokit reads too slowly: {outbox.dropped} messages dropped on this connection")
        self._dropped = outbox.dropped
        clocks = {"ros_ns": self.get_clock().now().nanoseconds, "monotonic_ns": time.monotonic_ns()}
        outbox.put({"kind": "time", **clocks, "dropped": self._dropped})
        topics = {topic: types for topic, types in self.get_topic_names_and_types() if self.count_publishers(topic)}
        hearers = {topic: [*map(endpoint, self.get_subscriptions_info_by_topic(topic))] for topic in self._advertised}
        outbox.put({"kind": "graph", "topics": topics, "publishers": publishers, "subscriptions": hearers})

    def _publish_not_connected(self) -> None:
        level = DiagnosticStatus.ERROR if self._was_connected else DiagnosticStatus.WARN
        values = [KeyValue(key="messages dropped", value=str(self._dropped))]
        status = DiagnosticStatus(level=level, name="dlokit: not connected", message=self._said, values=values)
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._advertise(DIAGNOSTICS)
        self._advertised[DIAGNOSTICS["topic"]][1].publish(message)

    def _work(self) -> None:
        while not self._frames.empty():
            header, payload = self._frames.get()
            if header["kind"] == "begin":
                self._begin(payload)
            elif header["kind"] == "publish" and header["topic"] in self._advertised:
                publisher = self._advertised[header["topic"]][1]
                self._try(lambda _, publisher=publisher, payload=payload: publisher.publish(payload), header)
            elif header["kind"] in ("advertise", "subscribe"):
                self._try(self._advertise if header["kind"] == "advertise" else self._subscribe, header)

    def _try(self, call: Callable[[dict[str, Any]], Any], header: dict[str, Any]) -> Any:
        try:
            return call(header)
        except Exception as error:  # a name, a type or a depth that ROS refuses
            self._wanted.pop(header["topic"], None)
            self.get_logger().warning(f"{header['topic']} is left out: {error}")
            if outbox := self._outbox:
                outbox.put({"kind": "lacks", "topic": header["topic"], "why": str(error)})
            return []

    def _begin(self, outbox: link.Outbox | None) -> None:
        """Begin a connection, or end it: nothing of the previous one stays but publishers, for late subscribers."""
        self._wanted.clear()
        for topic in list(self._heard):
            self._unsubscribe(topic)
        self._outbox = outbox
        if outbox:
            self._dropped, self._was_connected = 0, True
            self._tick()

    def _advertise(self, header: dict[str, Any]) -> None:
        topic, class_ = header["topic"], message_class(header["type"])
        if topic in self._advertised:
            if self._advertised[topic][0] == header:
                return  # late subscribers still get its last message
            self.destroy_publisher(self._advertised.pop(topic)[1])
        profile = profile_for([{**header, "reliable": True}], header["depth"])
        self._advertised[topic] = header, self.create_publisher(class_, topic, profile)

    def _subscribe(self, header: dict[str, Any]) -> None:
        self._unsubscribe(header["topic"])
        self._wanted[header["topic"]] = header
        self._look(header)

    def _unsubscribe(self, topic: str) -> None:
        if topic in self._heard:
            self.destroy_subscription(self._heard.pop(topic)[1])

    def _look(self, header: dict[str, Any]) -> list[dict[str, Any]]:
        """The publishers of a wanted topic; the subscription follows what they offer."""
        topic, type_, class_ = header["topic"], header["type"], message_class(header["type"])
        publishers = [*map(endpoint, self.get_publishers_info_by_topic(topic))]
        fitting = [one for one in publishers if one["type"] == type_]
        profile = profile_for(fitting, header["depth"])
        if not fitting or (topic in self._heard and self._heard[topic][0] == profile):
            return publishers

        def forward(message: bytes) -> None:
            if outbox := self._outbox:
                arrived_ns = time.monotonic_ns()
                outbox.put({"kind": "received", "topic": topic, "type": type_, "arrived_ns": arrived_ns}, message)

        self._unsubscribe(topic)
        self._heard[topic] = profile, self.create_subscription(class_, topic, forward, profile, raw=True)
        return publishers

    def _keep_link(self) -> None:
        while not self._ending.is_set():
            wait_s, path = RETRY_S, Path()
            try:
                path = link.runtime_folder(self._folder) / "ros2" / f"{self._name}.sock"
                self._converse(path)
            except (OSError, EOFError, queue.Full) as error:
                why = getattr(error, "strerror", None) or error
                self._say(f"waiting for dlokit at {path} ({why}): start it as this user, with --ros2 or --camera ros2")
            except link.LinkError as error:
                wait_s = REFUSED_RETRY_S
                self._say(f"no link to dlokit: {error}")
            self._ending.wait(wait_s)

    def _say(self, sentence: str) -> None:
        if sentence != self._said and not self._ending.is_set():
            self._said = sentence
            self.get_logger().info(sentence)

    def _converse(self, path: Path) -> None:
        with socket.socket(socket.AF_UNIX) as connection, connection.makefile("rb") as stream:
            self._connection = connection
            connection.settimeout(link.SILENT_S)
            connection.connect(str(path))
            names = {"node": self.get_fully_qualified_name(), "rmw": get_rmw_implementation_identifier()}
            versions = {"version": link.VERSION, "package": __version__, "distribution": distribution()}
            connection.sendall(link.encode({"kind": "hello", **names, **versions, "hashes": type_hashes()}))
            answer, _ = link.read(stream)
            if answer["kind"] != "welcome" or answer["version"] != link.VERSION:
                raise link.LinkError(answer.get("why") or f"its answer is not of version {link.VERSION}: {answer}")
            self._say(f"connected to dlokit {answer['dlokit']}")
            outbox = link.Outbox()
            writer = threading.Thread(target=outbox.send_to, args=(connection,), name="link writer", daemon=True)
            writer.start()
            try:
                self._hand_over({"kind": "begin"}, outbox)
                while True:
                    self._hand_over(*link.read(stream))
            finally:
                outbox.close()
                link.shut(connection)
                writer.join()
                self._hand_over({"kind": "begin"}, None)

    def _hand_over(self, header: dict[str, Any], payload: Any) -> None:
        self._frames.put((header, payload), timeout=1.0)  # ROS does not take so long
        self._wake.trigger()


def main() -> int:
    """Run the node until Ctrl-C or SIGTERM; returns its exit code."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    parser = argparse.ArgumentParser("bridge", usage=USAGE, description=__doc__)
    node = None
    try:
        parser.parse_args(remove_ros_args(sys.argv)[1:])
        rclpy.init()
        node = Bridge()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception as error:
        if node is None:
            parser.error(str(error))  # of the arguments or parameters
        if rclpy.ok():
            raise  # else it is that of a call that the end has interrupted
    finally:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        rclpy.try_shutdown()
        if node is not None:
            node.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
