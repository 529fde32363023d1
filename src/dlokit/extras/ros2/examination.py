"""Checks before a run that uses ROS 2: the link is free, a node is there, and the camera's topics give pictures."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

from dlokit.communication.timing.clock import LoopClock
from dlokit.extras.ros2.camera import Ros2CameraConfig
from dlokit.extras.ros2.definitions import DISTRIBUTIONS, definitions_of
from dlokit.extras.ros2.link.node_link import NodeLink, link_socket, listening
from dlokit.extras.ros2.pictures.sight import RosSight
from dlokit.system.config import RunConfig


def check_before_start(run: RunConfig) -> None:
    """Raise `InputError` when the link is taken; for a camera also without a node, or without usable pictures."""
    definitions_of(DISTRIBUTIONS[0])  # needs rosbags
    if isinstance(run.camera, Ros2CameraConfig):
        run.camera.check_topics()
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        asyncio.run(_examine(run))
        return
    with ThreadPoolExecutor(1) as thread:  # a notebook runs a loop of its own
        thread.submit(asyncio.run, _examine(run)).result()


async def _examine(run: RunConfig) -> None:
    path = link_socket(run.ros2.link)
    if not isinstance(run.camera, Ros2CameraConfig):  # a run that only publishes does not wait for a node
        async with listening(NodeLink(lambda hello: None, lambda header, payload: None), path):
            return
    link = NodeLink(lambda hello: sight.joined(), lambda header, payload: sight.heard(header, payload))
    sight = RosSight(run, run.camera, link, LoopClock())
    async with listening(link, path):
        await sight.examined()
