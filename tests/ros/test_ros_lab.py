"""The lab itself: what it publishes is heard, and nothing of it is left however the tests end."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from live_systems import runs
from ros_lab import HANGS_S, RosEnvironment, RosNetwork, ros_network, why_no_namespace

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"


@pytest.mark.smoke
def test_pictures_with_their_calibration_arrive_as_they_were_given(lab: RosNetwork) -> None:
    camera, listener = lab.camera(), lab.listener()
    for topic, kind in (("/colour", IMAGE), ("/camera_info", INFO)):
        camera.order("topic", topic=topic, type=kind)
        listener.order("subscribe", topic=topic, type=kind)
        camera.order("await", topic=topic, count=1)
        camera.hear("matched", topic=topic)
    pixels = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8).tobytes()
    size = {"stamp_ns": 1_700_000_000_123_456_789, "frame": "optical", "width": 64, "height": 48}
    k = [60.0, 0.0, 31.5, 0.0, 61.0, 23.5, 0.0, 0.0, 1.0]
    camera.order("image", pixels, topic="/colour", encoding="rgb8", step=192, **size)
    camera.order("info", topic="/camera_info", model="plumb_bob", d=[0.1, 0.0, 0.0, 0.0, 0.0], k=k, **size)

    picture, info = listener.hear("message", topic="/colour"), listener.hear("message", topic="/camera_info")

    assert picture["stamp_ns"] == info["stamp_ns"] == size["stamp_ns"]
    assert picture["fields"]["data"] == {"length": len(pixels), "sha256": hashlib.sha256(pixels).hexdigest()}
    assert (picture["fields"]["encoding"], picture["fields"]["step"]) == ("rgb8", 192)
    assert info["fields"]["k"] == k
    assert info["fields"]["d"] == [0.1, 0.0, 0.0, 0.0, 0.0]


def test_a_late_subscriber_gets_all_static_transforms(lab: RosNetwork, tf: None) -> None:
    camera, kind = lab.camera(), "tf2_msgs/msg/TFMessage"
    pose = {"position_m": [1.0, 2.0, 3.0], "xyzw": [0.0, 0.0, 0.6, 0.8], "stamp_ns": 0, "static": True}
    camera.order("transform", parent="base_link", child="camera_link", **pose)
    camera.order("transform", parent="camera_link", child="optical", **pose)
    listener = lab.listener()
    listener.order("subscribe", topic="/tf_static", type=kind, transient_local=True, depth=1)

    transforms = listener.hear("message", topic="/tf_static")["fields"]["transforms"]

    assert [one["child_frame_id"] for one in transforms] == ["camera_link", "optical"]
    assert transforms[1]["transform"]["rotation"] == {"x": 0.0, "y": 0.0, "z": 0.6, "w": 0.8}


def test_a_reliable_reader_hears_nothing_of_a_best_effort_camera_and_is_told_why(lab: RosNetwork) -> None:
    camera, listener = lab.camera(), lab.listener()
    camera.order("topic", topic="/colour", type=IMAGE, reliable=False)
    listener.order("subscribe", topic="/colour", type=IMAGE, reliable=True)
    assert "RELIABILITY" in listener.hear("incompatible", topic="/colour")["policy"]


def test_a_camera_drives_itself_at_its_rate(lab: RosNetwork) -> None:
    camera, listener = lab.camera(), lab.listener()
    topics = {"colour": "/colour", "depth": "/depth", "info": "/camera_info"}
    for setting, topic in topics.items():
        kind = INFO if setting == "info" else IMAGE
        listener.order("subscribe", topic=topic, type=kind, depth=100)
    camera.order("drive", **topics, frame="optical", width=64, height=48, hz=50.0, seconds=0.4)
    assert camera.hear("driven")["published"] == 20
    stamps = [[listener.hear("message", topic=topic)["stamp_ns"] for topic in topics.values()] for _ in range(20)]
    assert all(len(set(of_one_picture)) == 1 for of_one_picture in stamps)
    assert len({of_one_picture[0] for of_one_picture in stamps}) == 20


def test_two_labs_do_not_hear_each_other(lab: RosNetwork, ros_environment: RosEnvironment, tmp_path: Path) -> None:
    if why_no_namespace():
        pytest.skip(why_no_namespace())
    lab.camera().order("topic", topic="/mine", type=IMAGE)
    with ros_network(ros_environment, tmp_path) as other:
        other.variables["ROS_DOMAIN_ID"] = lab.variables["ROS_DOMAIN_ID"]
        both = other.listener()
        other.camera().order("topic", topic="/other", type=IMAGE)
        topics = list[str]()
        while "/other" not in topics:
            both.order("graph")
            topics = both.hear("graph")["topics"]
    assert "/mine" not in topics


def test_nodes_find_each_other_on_the_loopback_too(ros_environment: RosEnvironment, tmp_path: Path) -> None:
    with ros_network(ros_environment, tmp_path, namespace=False) as lab:
        camera, listener = lab.camera(), lab.listener()
        camera.order("topic", topic="/colour", type=IMAGE)
        listener.order("subscribe", topic="/colour", type=IMAGE)
        camera.order("await", topic="/colour", count=1)
        camera.hear("matched")


SCRIPT = """
import json, sys, time
from pathlib import Path
from ros_lab import RosEnvironment, ros_network
with ros_network(RosEnvironment(sys.argv[1]), Path(sys.argv[2])) as lab:
    bare, _ = lab.process("sleep", "1000")
    print(json.dumps([lab.camera().process.pid, lab.listener().process.pid, bare.pid]), flush=True)
    time.sleep(1000)
"""


@pytest.mark.smoke
def test_all_programs_end_when_the_tests_are_killed(ros_environment: RosEnvironment, tmp_path: Path) -> None:
    if why_no_namespace():
        pytest.skip(why_no_namespace())
    command = (sys.executable, "-c", SCRIPT, ros_environment.distribution, str(tmp_path))
    helpers = str(Path(__file__).parents[1] / "helpers")
    environment = {**os.environ, "PYTHONPATH": helpers}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as tests:
        assert tests.stdout is not None
        pids = json.loads(tests.stdout.readline())
        assert all(runs(pid) for pid in pids)
        tests.send_signal(signal.SIGKILL)
    end_s = time.monotonic() + HANGS_S
    while any(runs(pid) for pid in pids):
        assert time.monotonic() < end_s
        time.sleep(0.05)
