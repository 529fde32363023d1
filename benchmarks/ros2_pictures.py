"""Do all pictures of a ROS 2 camera arrive in dlokit, how old are they there, and what does the node cost?

python benchmarks/ros2_pictures.py --seconds 60
A node of real ROS 2 publishes 640 x 480 px of colour with depth at 30 Hz; the node of the workspace passes them to
dlokit, which decodes each pair. `make test-ros` installs ROS 2.
"""

import asyncio
import os
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import psutil
from rich.console import Console

from dlokit import geometry
from dlokit.errors import CommunicationError, MachineError
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import Interval
from dlokit.extras.ros2.link import frames
from dlokit.extras.ros2.link.node_link import NODE_WITHIN_S, NodeLink, link_socket, listening
from dlokit.extras.ros2.pictures.sources import PictureSource
from dlokit.functional.cameras.picture_topics import PictureTopics
from parts.command import check_json, run_study, write_figures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

COLOUR, DEPTH = "/camera/color/image_raw", "/camera/depth/image_raw"
_HZ = 30.0
_LOOK_S = 1.0


@dataclass(frozen=True, kw_only=True)
class Args:
    """Publish pictures with depths, and measure what arrives."""

    distribution: Literal["jazzy", "kilted"] = "jazzy"
    """Distribution of ROS 2."""
    seconds: float = 60.0
    """Time for which pictures are published [s]."""
    best_effort: bool = False
    """Publish with best effort, as many drivers do."""
    large_data: bool = False
    """With FASTDDS_BUILTIN_TRANSPORTS=LARGE_DATA."""
    json: Path | None = None
    """Write the figures to this file."""


@dataclass
class Measured:
    """What arrived."""

    pairs: int = 0
    ages_s: list[float] = field(default_factory=list[float])
    """Time from the stamp of a pair to its pictures in dlokit [s]."""
    node_cpu_s: float = 0.0
    """Processor time of the node while pictures were published [s]."""
    node_mib: list[float] = field(default_factory=list[float])
    """Memory of the node, each second [MiB]."""
    own_mib: list[float] = field(default_factory=list[float])
    """Memory of this process, each second [MiB]."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    from ros_lab import RosEnvironment, ros_network

    check_json(args.json)
    environment = RosEnvironment(args.distribution)
    if why_not := environment.why_not():
        raise MachineError(why_not)
    console = Console(highlight=False, soft_wrap=True)
    variables = {"FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA"} if args.large_data else {}
    with tempfile.TemporaryDirectory(prefix="dlk") as folder:
        runtime = Path(folder) / "r"
        runtime.mkdir(mode=0o700)
        os.environ["DLOKIT_RUNTIME_DIR"] = str(runtime)
        with ros_network(environment, Path(folder)) as network:
            bridge, _ = network.bridge(runtime, variables=variables)
            camera = network.camera(variables=variables)
            measured = asyncio.run(_measured(args, camera, psutil.Process(bridge.pid)))
    published = round(args.seconds * _HZ)
    write_figures(args.json, "ros2_pictures", _told(args, measured, published, console), vars(args), console)
    return 0


def _told(args: Args, measured: Measured, published: int, console: Console) -> list[BenchFigure]:
    method = f"{'best effort' if args.best_effort else 'reliable'}, {'LARGE_DATA' if args.large_data else 'defaults'}"
    ages_s = np.array(measured.ages_s)
    half = len(measured.node_mib) // 2
    figures = {
        "pairs that arrived": (measured.pairs / published, "1"),
        "stamp to pictures, median": (float(np.median(ages_s)), "s"),
        "stamp to pictures, 95 %": (float(np.quantile(ages_s, 0.95)), "s"),
        "processor of the node": (measured.node_cpu_s / args.seconds, "1"),
        "memory of the node, second half to first": (_growth(measured.node_mib, half), "MiB"),
        "memory of dlokit, second half to first": (_growth(measured.own_mib, half), "MiB"),
    }
    console.print(f"{args.distribution}, {method}: {measured.pairs} of {published} pairs")
    for name, (value, unit) in figures.items():
        shown = f"{value * 1e3:.1f} ms" if unit == "s" else f"{value:.3f} {unit if unit != '1' else ''}"
        console.print(f"  {name}: {shown}")
    return [
        figure(args.distribution, method, name, Interval(value=value, low=None, high=None, n=len(ages_s)), unit)
        for name, (value, unit) in figures.items()
    ]


def _growth(mib: list[float], half: int) -> float:
    return 0.0 if half == 0 else float(np.median(mib[half:]) - np.median(mib[:half]))


async def _measured(args: Args, camera: Any, bridge: psutil.Process) -> Measured:
    measured = Measured()
    pose = geometry.pose((0.0, 0.0, 0.0))

    def heard(header: frames.FromNode, payload: bytes) -> None:
        if isinstance(header, frames.RosMessage):
            moment = source.add(header.topic, header.type, payload, header.arrived_ns)
            if moment is not None:
                source.pictures(moment, moment.stamp_ns, pose)
                measured.pairs += 1
                measured.ages_s.append((time.time_ns() - moment.stamp_ns) / 1e9)

    link = NodeLink(lambda hello: None, heard)
    source = PictureSource(
        PictureTopics(colour=COLOUR, depth=DEPTH), lambda kind, cdr: link.definitions.decode(kind, cdr)
    )
    async with listening(link, link_socket("dlokit")):
        if await link.wait_node(NODE_WITHIN_S) is None:
            raise CommunicationError("the node has not connected")
        for topic, kinds in source.kinds.items():
            link.send(frames.Subscribe(topic=topic, type=kinds[0]))
        infos = [topic for topic in source.kinds if topic not in (COLOUR, DEPTH)]
        begin_s = sum(bridge.cpu_times()[:2])
        camera.order(
            "drive",
            colour=COLOUR,
            depth=DEPTH,
            info=infos[0],
            frame="optical",
            width=640,
            height=480,
            hz=_HZ,
            seconds=args.seconds,
            reliable=not args.best_effort,
        )
        driven = asyncio.create_task(asyncio.to_thread(camera.hear, "driven", within_s=args.seconds + 60.0))
        while not driven.done():
            measured.node_mib.append(bridge.memory_info().rss / 2**20)
            measured.own_mib.append(psutil.Process().memory_info().rss / 2**20)
            await asyncio.wait({driven}, timeout=_LOOK_S)
        await driven
        measured.node_cpu_s = sum(bridge.cpu_times()[:2]) - begin_s
        await asyncio.sleep(_LOOK_S)  # the last pictures are on their way
    return measured


if __name__ == "__main__":
    run_study(Args, run, __doc__)
