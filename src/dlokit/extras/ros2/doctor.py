"""`dlokit doctor ros2`: check the connection to ROS 2, and find the settings of its cameras."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from rich.console import Console

from dlokit import __version__
from dlokit.app.commands import CliCommand, flag
from dlokit.app.console import say
from dlokit.errors import EXIT_FAULT, InputError
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import link_socket, listening
from dlokit.extras.ros2.survey import Survey
from dlokit.system.config import Ros2Config

_LISTEN_S = 5.0
"""Time for which topics are listened to [s]: discovery takes up to 2.5 s, and a slow camera takes 1 picture/s."""


@dataclass(frozen=True, kw_only=True)
class Ros2DoctorArgs:
    """Check the connection to ROS 2, and print the settings for the cameras that are published there.

    Start the node before, or within ten seconds: `ros2 run dlokit_ros bridge` in your workspace. No run may use the
    link at the same time. `ros2 run dlokit_ros check` checks the same without dlokit. Exit code: 0 a camera was found;
    1 none; 2 no node has connected, or bad input.
    """

    ros2: Ros2Config = field(default_factory=Ros2Config)
    """The connection to ROS 2."""
    report: Annotated[Path | None, flag("FILE")] = None
    """Write what was found to this text file, for a report of a bug."""


def run(args: Ros2DoctorArgs) -> int:
    """Listen, and print what was found."""
    survey = asyncio.run(_listen(args))
    console = Console()
    lines = list(lines_of(survey, args.ros2.frame))
    for line in lines:
        say(console, line)
    if args.report is not None:
        try:
            args.report.write_text("\n".join([*lines, ""]), encoding="utf-8")
        except OSError as error:
            raise InputError(f"--report {args.report}: {error}; name a file in a folder of yours.") from error
        say(console, f"written: {args.report}")
    return 0 if survey.settings() else EXIT_FAULT


async def _listen(args: Ros2DoctorArgs) -> Survey:
    survey = Survey()
    async with listening(survey.link, link_socket(args.ros2.link)):
        await survey.link.require_node()
        await asyncio.sleep(_LISTEN_S)
    return survey


def lines_of(survey: Survey, frame: str) -> Iterator[str]:
    """What was found, a line each."""
    yield f"dlokit {__version__}, link version {frames.VERSION}"
    if (node := survey.node) is not None:
        yield f"node {node.node}: ROS 2 {node.distribution}, {node.rmw}, dlokit_ros {node.package}"
    yield from map(str, survey.topics.values())
    for topic, why in survey.lacks.items():
        yield f"the node cannot subscribe to {topic}: {why}"
    for camera, where in survey.poses(frame):
        yield f"frame {camera}: {where}"
    if settings := survey.settings():
        yield f"settings: {settings}"
    else:
        yield "no camera: no colour with depths of its size and frame, no left and right picture, no cloud with colours"


COMMAND = CliCommand(Ros2DoctorArgs, run)
