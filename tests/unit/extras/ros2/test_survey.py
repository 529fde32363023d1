"""`dlokit doctor ros2`: what is found of cameras in ROS 2, and the settings for one."""

from typing import Any

import numpy as np
import pytest
import ros2_messages as ros
from made_nodes import HELLO, NodePeer
from ros2_messages import cdr

from dlokit import geometry
from dlokit.communication.timing import virtual_time
from dlokit.extras.ros2.doctor import lines_of
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.survey import Survey
from dlokit.geometry.camera import centred_camera

CAMERA = centred_camera(8, 6, 10.0, geometry.pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0)))
RGB, DEPTH = np.zeros((6, 8, 3), np.uint8), np.full((6, 8), 700, np.uint16)
PERIOD_NS = 100_000_000


def surveyed(messages: dict[str, list[Any]], *nodes: str) -> Survey:
    """The survey of a node that says what is published, with `nodes` as the publishers, and then the messages."""
    survey = Survey()
    kinds = {topic: found[0].__msgtype__ for topic, found in messages.items()}
    publishers = {
        topic: [frames.Endpoint(node=node, type=kind, reliable=True, transient_local=False) for node in nodes]
        for topic, kind in kinds.items()
    }
    topics = {topic: [kind] for topic, kind in kinds.items()}

    async def main() -> None:
        peer = NodePeer()
        peer.send(HELLO, frames.Graph(topics=topics, publishers=publishers, subscriptions={}))
        for topic, found in messages.items():
            for message in found:
                peer.send_message(frames.RosMessage(topic=topic, type=kinds[topic], arrived_ns=0), cdr(message))
        peer.reader.feed_eof()
        await peer.served_by(survey.link)

    virtual_time.run(main())
    return survey


def pictures(frame: str = "optical") -> dict[str, list[Any]]:
    stamps_ns = [1_000_000_000 + number * PERIOD_NS for number in range(4)]
    return {
        "/cam/color/image_raw": [ros.image(RGB, "rgb8", stamp_ns=one, frame=frame) for one in stamps_ns],
        "/cam/depth/image_raw": [ros.image(DEPTH, "16UC1", stamp_ns=one, frame="depth") for one in stamps_ns],
        "/cam/aligned/image_raw": [ros.image(DEPTH, "16UC1", stamp_ns=one, frame=frame) for one in stamps_ns],
        "/cam/color/camera_info": [ros.info(CAMERA, stamp_ns=one, frame=frame) for one in stamps_ns],
    }


def test_the_settings_name_the_depths_that_are_aligned_to_the_colours() -> None:
    survey = surveyed(pictures(), "/driver")
    expected = "--camera ros2 --camera.colour /cam/color/image_raw --camera.depth /cam/aligned/image_raw"
    assert survey.settings() == expected
    assert survey.topics["/cam/color/image_raw"].rate_hz == pytest.approx(10.0)
    line = str(survey.topics["/cam/color/image_raw"])
    assert line == "/cam/color/image_raw: Image rgb8 8 x 6, 10.0 Hz, reliable, frame optical"


def test_a_topic_of_two_publishers_is_named_and_not_proposed() -> None:
    survey = surveyed(pictures(), "/one", "/two")
    assert survey.topics["/cam/color/image_raw"].flaw == "published by /one and /two"
    assert survey.settings() == ""


def test_a_stereo_pair_and_a_cloud_are_proposed_where_there_are_no_depths() -> None:
    image = [ros.image(RGB, "rgb8", frame="left")]
    assert surveyed({"/left/image_rect": image, "/right/image_rect": image}, "/driver").settings() == (
        "--camera ros2 --camera.colour /left/image_rect --camera.right /right/image_rect"
    )
    cloud = [ros.cloud(np.ones((6, 8, 3), np.float32), RGB)]
    assert surveyed({"/points": cloud}, "/driver").settings() == "--camera ros2 --camera.cloud /points"


def test_the_report_says_where_the_camera_is_or_which_trees_there_are() -> None:
    place = geometry.pose((0.5, 0.0, 1.0), (0.0, 1.0, 0.0, 0.0))
    found = {**pictures(), "/tf_static": [ros.tf(("base_link", "optical", place))]}
    lines = list(lines_of(surveyed(found, "/driver"), "base_link"))
    assert "node /dlokit: ROS 2 jazzy, rmw_fastrtps_cpp, dlokit_ros 0.1.0" in lines
    assert "frame optical: at (0.500, 0.000, 1.000) m from base_link" in lines
    (lonely,) = [line for line in lines if line.startswith("frame depth:")]
    assert "base_link" in lonely
