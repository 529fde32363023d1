"""List what dlokit can see in this ROS 2 graph: cameras, their frames in TF, and the settings for dlokit.

Exit code: 0 a camera was found, 1 none, 2 bad arguments.
"""

import argparse
import os
import re
import socket
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.serialization import deserialize_message
from rclpy.utilities import get_rmw_implementation_identifier, remove_ros_args

from dlokit_ros import __version__, bridge, link

IMAGE, PACKED, CLOUD, INFO = (
    f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "PointCloud2", "CameraInfo")
)
TF = "tf2_msgs/msg/TFMessage"
LISTEN_S = 5.0  # discovery takes up to two seconds; three remain
ENVIRONMENT = re.compile(r"ROS_(DOMAIN|AUTO|STATIC|LOCALHOST|DISCOVERY)|RMW_|FASTDDS_|FASTRTPS_|CYCLONEDDS_|ZENOH_")
NO_CAMERA = """no camera for dlokit: it takes colour with depth of the same size and frame (realsense-ros:
align_depth.enable:=true), left and right, or a PointCloud2; pictures with a camera_info beside them"""


def listen(node: Any, within_s: float) -> tuple[dict[str, dict[str, Any]], dict[str, str], set[str]]:
    """Listen to cameras and TF: the topics, the parents of TF's frames, and the types that are missing here."""
    topics: dict[str, dict[str, Any]] = {}
    parents: dict[str, str] = {}
    lacks: set[str] = set()

    def look() -> None:
        for name, types in node.get_topic_names_and_types():
            publishers = [*map(bridge.endpoint, node.get_publishers_info_by_topic(name))]
            if name in topics:
                topics[name]["publishers"] = publishers or topics[name]["publishers"]
            elif publishers and types[0] in (IMAGE, PACKED, CLOUD, INFO, TF):
                topics[name] = {"name": name, "type": types[0], "publishers": publishers, "arrivals": []}
                subscribe(topics[name], 100 if types[0] == TF else 5)

    def subscribe(topic: dict[str, Any], depth: int) -> None:
        def hear(message: bytes) -> None:
            topic["arrivals"].append((time.monotonic(), node.get_clock().now().nanoseconds * 1e-9))
            topic["newest"] = message
            if topic["type"] == TF:
                transforms = deserialize_message(message, class_).transforms
                parents.update((one.child_frame_id, one.header.frame_id) for one in transforms)

        try:
            class_ = bridge.message_class(topic["type"])
            profile = bridge.profile_for(topic["publishers"], depth)
            node.create_subscription(class_, topic["name"], hear, profile, raw=True)
        except LookupError as error:
            lacks.add(str(error))

    node.create_timer(0.25, look)
    rclpy.spin_until_future_complete(node, rclpy.task.Future(), timeout_sec=within_s)
    for topic in topics.values():
        if "newest" in topic:
            topic["newest"] = deserialize_message(topic["newest"], bridge.message_class(topic["type"]))
    return topics, parents, lacks


def describe(topic: dict[str, Any], topics: dict[str, dict[str, Any]]) -> str:
    """A line about a topic; adds to it what settings are chosen by: encoding, size, frame, camera_info."""
    kinds = {"reliable" if one["reliable"] else "best effort" for one in topic["publishers"]}
    names = {one["node"] for one in topic["publishers"]}
    said = f"  {topic['name']}: {topic['type'].rpartition('/')[2]}, {' AND '.join(kinds)}, from {' AND '.join(names)}"
    if not (message := topic.get("newest")):
        return f"{said}, NO MESSAGE"
    folders = [topic["name"].rsplit("/", levels)[0] for levels in (1, 2)]  # a compressed picture is a level deeper
    infos = [topics.get(f"{folder}/camera_info", {}).get("newest") for folder in folders]
    topic["info"] = infos[0] or infos[1]
    sized = topic["info"] if topic["type"] == PACKED else message
    topic["size"] = getattr(sized, "width", 0), getattr(sized, "height", 0)
    topic["encoding"], topic["frame"] = (
        getattr(message, "encoding", getattr(message, "format", "")),
        message.header.frame_id,
    )
    (first_s, _), (last_s, arrived_s) = topic["arrivals"][0], topic["arrivals"][-1]
    rate = (len(topic["arrivals"]) - 1) / max(last_s - first_s, 1e-9)
    age_ms = (arrived_s - message.header.stamp.sec) * 1e3 - message.header.stamp.nanosec * 1e-6
    said += f", {topic['encoding']} {topic['size'][0]}x{topic['size'][1]}, {rate:.1f} Hz, {age_ms:.0f} ms old"
    return f"{said}, frame {topic['frame']}{'' if topic['info'] or topic['type'] == CLOUD else ', NO camera_info'}"


def tf_line(parents: dict[str, str], base: str, frame: str) -> str:
    """The TF chain from base to a frame, or the two trees in which they are."""
    up, down = [base], [frame]
    for chain in (up, down):
        while (parent := parents.get(chain[-1])) and parent not in chain:
            chain.append(parent)
    if up[-1] != down[-1]:
        return f"  NO CHAIN: two trees, {' > '.join(reversed(up))} and {' > '.join(reversed(down))}"
    meeting = next(one for one in up if one in down)
    return f"  {' > '.join([*up[: up.index(meeting) + 1], *reversed(down[: down.index(meeting)])])}"


def settings(topics: list[dict[str, Any]]) -> str:
    """dlokit's settings for the best camera among described topics; empty if there is none."""
    heard = sorted((one for one in topics if "frame" in one), key=lambda one: (one["type"] == PACKED, one["name"]))
    pictures = [one for one in heard if one["type"] in (IMAGE, PACKED)]
    depths = [one for one in pictures if re.match("16UC1|32FC1", one["encoding"])]
    colours = [one for one in pictures if one not in depths and one["info"]]
    for colour in sorted(colours, key=lambda one: "mono" in one["encoding"]):
        for depth in depths:
            if (colour["size"], colour["frame"]) == (depth["size"], depth["frame"]):
                return f"--camera ros2 --camera.colour {colour['name']} --camera.depth {depth['name']}"
    for left in colours:
        for right in colours:
            if right["name"] != left["name"] == right["name"].replace("right", "left"):
                return f"--camera ros2 --camera.colour {left['name']} --camera.right {right['name']}"
    return next((f"--camera ros2 --camera.cloud {one['name']}" for one in heard if one["type"] == CLOUD), "")


def link_line(name: str, folder: str) -> str:
    """Whether dlokit listens at the socket of the link."""
    try:
        path = link.runtime_folder(folder) / "ros2" / f"{name}.sock"
        with socket.socket(socket.AF_UNIX) as connection:
            code = connection.connect_ex(str(path))
        return f"link {path}: dlokit {f'does not listen ({os.strerror(code)})' if code else 'listens'}"
    except link.LinkError as error:
        return f"link {name}: {error}"


def report(base: str) -> tuple[list[str], str]:
    """The lines of the report, and the settings of a camera if there is one."""
    topics, parents, lacks = listen(rclpy.create_node("dlokit_check"), LISTEN_S)
    cameras = sorted((one for one in topics.values() if one["type"] != TF), key=lambda one: one["name"])
    told = [describe(one, topics) for one in cameras] or ["  none: is the camera in the same domain?"]
    chains = [tf_line(parents, base, frame) for frame in sorted({one["frame"] for one in cameras if "frame" in one})]
    chosen = settings(cameras)
    versions = f"dlokit_ros {__version__}, Python {sys.version.split()[0]}, ROS 2 {bridge.distribution() or 'unknown'}"
    lines = [f"{versions}, {get_rmw_implementation_identifier()}, domain {os.environ.get('ROS_DOMAIN_ID') or 0}"]
    lines += [f"  {name}={value}" for name, value in sorted(os.environ.items()) if ENVIRONMENT.match(name)]
    lines += ["topics of cameras:", *told, f"TF from {base}:", *chains, *lacks]
    return [*lines, f"dlokit track {chosen} --ros2" if chosen else NO_CAMERA], chosen


def main() -> int:
    """Print the report; returns the exit code."""
    parser = argparse.ArgumentParser("check", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frame", default="base_link", help="frame from which to look for cameras in TF (base_link)")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the same to a file, for a bug report")
    parser.add_argument("--link", default="dlokit", help="name of the link, as dlokit's --ros2.link (dlokit)")
    parser.add_argument("--runtime-dir", default="", help="dlokit's folder of sockets")
    try:
        arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
        rclpy.init()
        lines, chosen = report(arguments.frame)
        print(text := "\n".join([link_line(arguments.link, arguments.runtime_dir), *lines]))
        if arguments.report:
            arguments.report.write_text(f"{text}\n", encoding="utf-8")
        return 0 if chosen else 1
    except (KeyboardInterrupt, ExternalShutdownException):
        return 1
    except (OSError, RuntimeError) as error:
        return parser.error(str(error))
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
