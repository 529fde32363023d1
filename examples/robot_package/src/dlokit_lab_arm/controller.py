"""A simulated controller, in place of the one that comes with an arm: `python -m dlokit_lab_arm.controller`.

It accepts connections over TCP and speaks lines of JSON: orders in, its state out 250 times a second. As a controller
must, it brakes when heartbeats end and keeps the latched stop, so that both hold when the driver has died.
"""

import argparse
import asyncio
import contextlib
import json
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PERIOD_S = 0.004
BRAKE_S = 0.25
"""Time in which a braked motion comes to rest on its path [s]."""
LAG = 0.22
"""Fraction of the distance to the set-point that the joints move in a period."""
FINGERS_M_S = 0.1
AT_REST_RAD = 1e-4
HOME_Q = (0.0, -0.9, 0.0, -2.5, 0.0, 1.6, 0.785)  # seven joints, near the looking position of a Panda


class Controller:
    """The state of arm and fingers."""

    def __init__(self, q_rad: Array, width_m: float = 0.08) -> None:
        self.q, self.dq, self.set_point = q_rad, np.zeros_like(q_rad), q_rad
        self.width_m = self.wanted_m = width_m
        self.latched = False
        self.motion: dict[str, Any] | None = None
        self.motion_id, self.ended, self.error_rad = 0, "", 0.0
        self.grip_id = 0
        self.beat_s = self.t_s = 0.0
        self.rate, self.braked_by = 1.0, ""
        self.lease_s = 0.0

    def order(self, said: dict[str, Any], now_s: float) -> None:
        """Obey an order."""
        match said["order"]:
            case "follow":
                self.motion_id, self.ended, self.error_rad = said["id"], "", 0.0
                if self.latched or self.motion is not None:
                    self.ended = "refused"
                    return
                self.motion = {"times": np.array(said["times"]), "q": np.array(said["q"])}
                self.t_s, self.rate, self.braked_by = 0.0, 1.0, ""
                self.beat_s, self.lease_s = now_s, said["lease_s"]
            case "grip":
                self.grip_id = said["id"]
                if not self.latched:
                    self.wanted_m = said["width_m"]
                    self.beat_s, self.lease_s = now_s, said["lease_s"]
            case "beat":
                self.beat_s = now_s
            case "brake":
                self._brake("brake")
            case "hold":
                self.wanted_m = self.width_m
            case "stop":
                self.latched = True
                self.wanted_m = self.width_m
                self._brake("stop")
            case "enable":
                self.latched = False
            case _:
                pass

    def step(self, now_s: float) -> None:
        """Move for one period."""
        if now_s - self.beat_s > self.lease_s:
            self.wanted_m = self.width_m
            self._brake("lease")
        before = self.q
        if self.motion is not None:
            self._advance(self.motion)
        self.q = self.q + LAG * (self.set_point - self.q)
        self.dq = (self.q - before) / PERIOD_S
        reach_m = FINGERS_M_S * PERIOD_S
        self.width_m += float(np.clip(self.wanted_m - self.width_m, -reach_m, reach_m))

    def _advance(self, motion: dict[str, Any]) -> None:
        if self.braked_by:
            self.rate = max(0.0, self.rate - PERIOD_S / BRAKE_S)  # slower and slower along the path
        self.t_s += self.rate * PERIOD_S
        self.set_point = np.array([np.interp(self.t_s, motion["times"], joint) for joint in motion["q"].T])
        off_rad = float(np.abs(self.set_point - self.q).max())
        self.error_rad = max(self.error_rad, off_rad)
        arrived = self.t_s >= motion["times"][-1]
        if off_rad < AT_REST_RAD and (arrived or self.rate == 0.0):
            self.motion, self.ended = None, "arrived" if arrived else self.braked_by

    def _brake(self, why: str) -> None:
        if self.motion is not None and not self.braked_by:
            self.braked_by = why

    def state(self) -> dict[str, Any]:
        """What is sent to the driver."""
        return {
            "q": self.q.tolist(),
            "dq": self.dq.tolist(),
            "width_m": self.width_m,
            "wanted_m": self.wanted_m,
            "grip": self.grip_id,
            "phase": "idle" if self.motion is None else "braking" if self.braked_by else "moving",
            "latched": self.latched,
            "motion": self.motion_id,
            "ended": self.ended,
            "error_rad": self.error_rad,
        }


async def serve(controller: Controller, port: int) -> None:
    """Run until it is ended; port 0 is any free one. Prints the port."""
    drivers = set[asyncio.StreamWriter]()

    async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        drivers.add(writer)
        with contextlib.suppress(ConnectionError):
            async for line in reader:
                controller.order(json.loads(line), time.monotonic())
        drivers.discard(writer)
        writer.close()

    server = await asyncio.start_server(connected, "127.0.0.1", port, limit=2**24)
    print(f"listening on port {server.sockets[0].getsockname()[1]}", flush=True)
    due_s = time.monotonic()
    while True:
        controller.step(time.monotonic())
        line = json.dumps(controller.state()).encode() + b"\n"
        for writer in drivers:
            writer.write(line)
        due_s += PERIOD_S  # a late step is caught up, so that motions take their time on a busy machine too
        await asyncio.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--port", type=int, default=7501)
    parser.add_argument("--q", type=float, nargs="+", default=HOME_Q, help="angles at the start, one a joint [rad]")
    args = parser.parse_args()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(serve(Controller(np.array(args.q, dtype=float)), args.port))
