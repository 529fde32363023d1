"""What the viewer's page costs its server: clouds of many points, drawn many times a second.

    python benchmarks/page.py
    python benchmarks/page.py --points 100000 --json page.json

A viewer in a process of its own gets clouds over a bus and draws them for a client that reads all it is sent, as a
browser does that keeps up. The computing time includes encoding and decoding the clouds, as on the bus of a live run.
"""

import asyncio
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import viser
import websockets
import zstandard
from rich.console import Console

from dlokit.errors import ConfigError
from dlokit.extras.bench.report import figure
from dlokit.extras.bench.statistics import Interval
from parts.command import check_json, run_study, write_figures

STARTS_S = 60.0
"""Longest wait for the server's process [s]."""
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.6, -0.7, 1.0),
    "fov": 0.8,
    "near": 0.01,
    "far": 100.0,
    "image_height": 800,
    "image_width": 1280,
    "look_at": (0.4, 0.0, 0.2),
    "up_direction": (0.0, 0.0, 1.0),
}
"""The message without which viser counts nobody as present."""


@dataclass(frozen=True, kw_only=True)
class Args:
    """Draw clouds on the page, and print the computing time of its server."""

    points: int = 20_000
    """Points of each cloud."""
    rate_hz: float = 30.0
    """Clouds per second [1/s]."""
    seconds: float = 20.0
    """Duration of the measurement [s]."""
    json: Path | None = None
    """Also write every figure to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    if not (args.points > 0 and args.rate_hz > 0.0 and args.seconds > 0.0):
        raise ConfigError("--points, --rate-hz and --seconds must be above 0.")
    check_json(args.json)
    console = Console()
    cores, drawn_hz = asyncio.run(_measured(args))
    console.print(
        f"{args.points} points at {args.rate_hz:g} Hz: the server takes {100.0 * cores:.0f} % of a core; "
        f"{drawn_hz:.1f} clouds per second arrive at the client",
        highlight=False,
    )
    rows = [
        figure("page", "dlokit", "computing time of the server", _one(cores), "cores"),
        figure("page", "dlokit", "clouds at the client", _one(drawn_hz), "1/s"),
    ]
    config = {"points": args.points, "rate_hz": args.rate_hz, "seconds": args.seconds}
    write_figures(args.json, "page", rows, config, console)
    return 0


def _one(value: float) -> Interval:
    return Interval(value=value, low=None, high=None, n=1)


async def _measured(args: Args) -> tuple[float, float]:
    """Cores that the server keeps busy, and clouds per second that arrive."""
    script = Path(__file__).parent / "parts" / "page_server.py"
    server = await asyncio.create_subprocess_exec(
        sys.executable,
        str(script),
        str(args.points),
        str(args.rate_hz),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    assert server.stdin is not None
    assert server.stdout is not None
    try:
        address = (await asyncio.wait_for(server.stdout.readline(), STARTS_S)).decode().strip()
        clouds = await _clouds(address, server.stdin, args.seconds)
        server.stdin.close()
        took = json.loads(await asyncio.wait_for(server.stdout.read(), STARTS_S))
    finally:
        if server.returncode is None:
            server.terminate()
        await server.wait()
    return took["cpu_s"] / took["wall_s"], clouds / took["wall_s"]


async def _clouds(address: str, server: asyncio.StreamWriter, seconds: float) -> int:
    """Read what the page is sent for a time; returns the number of clouds."""
    url = address.replace("http://", "ws://")
    count = 0
    async with websockets.connect(
        url,
        subprotocols=[websockets.Subprotocol(f"viser-v{viser.__version__}")],
        origin=websockets.Origin(address.rpartition("/")[0]),
        max_size=None,
        compression=None,
    ) as socket:
        await socket.send(msgspec.msgpack.encode(CAMERA))
        while not _has_cloud(await asyncio.wait_for(socket.recv(), STARTS_S)):
            pass
        server.write(b"begin\n")
        until_s = asyncio.get_running_loop().time() + seconds
        while asyncio.get_running_loop().time() < until_s:
            count += _has_cloud(await asyncio.wait_for(socket.recv(), STARTS_S))
    return count


def _has_cloud(data: Any) -> bool:
    """Whether a message of viser sets the points of a cloud."""
    size = int.from_bytes(data[8:16], "little")
    inner = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
    return any("points" in message.get("updates", message.get("props", {})) for message in inner["messages"])


if __name__ == "__main__":
    run_study(Args, run, __doc__)
