"""The hand process: the only process that commands the gripper, whose calls block while the fingers move.

The measured width decides whether the fingers hold an object: for the same failed grasp the library returns False,
returns True or raises, depending on the server. The fingers stop at once when the driver's heartbeat is too old.

    python -m dlokit.extras.franka.hand FILE ADDRESS ARM
"""

import importlib
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from dlokit.extras.franka.channel import Channel, GripKind, HandState, Word
from dlokit.extras.franka.panda_link import ARM as PANDA
from dlokit.extras.franka.panda_link import FrankaRsFingers

PERIOD_S = 0.005
SPEED_M_S = 0.1
"""Speed at which the distance of the fingers changes [m/s]."""
STILL_M = 1e-4
STILL_S = 0.3
"""Fingers whose distance changes by less than `STILL_M` [m] within this time [s] are at rest."""
LONGEST_S = 8.0
"""After this time [s] a call is abandoned, and the fingers are stopped."""
EMPTY_M = 0.002
"""Fingers that end within this distance of their target [m] hold nothing: thinner wires cannot be detected."""
ANY_WIDTH_M = 0.08
HOMED = 0.9
"""A hand whose largest width is below this fraction of the model's was not homed since it was switched on."""


@dataclass(frozen=True, kw_only=True)
class FingerVerdict:
    """How a motion of the fingers ended."""

    held: bool = False
    jammed: bool = False
    """The fingers opened less than ordered."""


def judged(target_m: float, before_m: float, width_m: float) -> FingerVerdict:
    """The end of a motion ordered from `before_m` to `target_m`, with the fingers at rest at `width_m` [m]."""
    if target_m <= before_m:
        return FingerVerdict(held=width_m > target_m + EMPTY_M)
    return FingerVerdict(jammed=width_m < target_m - EMPTY_M)


class FingerCommands(Protocol):
    """The part of ``franky.Gripper`` that the hand process uses; `FrankaRsFingers` has it too."""

    @property
    def state(self) -> Any:
        """Width, largest width; waits for the next packet."""
        ...

    def move(self, width: float, speed: float) -> bool:
        """Blocks while the fingers move."""
        ...

    def grasp(self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float) -> bool:
        """Blocks until they hold an object or the grasp has failed."""
        ...

    def homing(self) -> bool:
        """Blocks while they open and close."""
        ...

    def stop(self) -> bool:
        """Hold the present width."""
        ...


class HandLoop:
    """The states of the hand process, one turn at a time."""

    def __init__(
        self,
        channel: Channel,
        gripper: FingerCommands,
        parent_alive: Callable[[], bool],
        start: Callable[[Callable[[], None]], None],
    ) -> None:
        """`start` runs a blocking call in parallel to the loop."""
        self._channel, self._gripper = channel, gripper
        self._parent_alive, self._start = parent_alive, start
        self._grip_id = channel[Word.GRIP_ID]
        self._running = self._cancelled = False
        self._returned: set[int] = set()
        self._began_ns = self._moved_ns = 0
        self._still_m = self._before_m = 0.0

    def turn(self, now_ns: int) -> bool:
        """One turn; False at the end. Any error of the gripper counts as a lost connection."""
        channel = self._channel
        channel[Word.HAND_BEAT_NS] = now_ns
        state = self._gripper.state
        if abs(state.width - self._still_m) > STILL_M:
            self._still_m, self._moved_ns = state.width, now_ns
        if self._running:
            self._look(now_ns)
        elif channel[Word.CLOSE] or not self._parent_alive():
            return False
        elif (wanted := channel[Word.GRIP_ID]) > self._grip_id:
            self._begin(wanted, state.width, now_ns)
        channel.write_hand(
            HandState(
                read_ns=now_ns,
                grip_id=self._grip_id,
                running=self._running,
                cancelled=self._cancelled,
                width_m=state.width,
                largest_width_m=state.max_width,
                before_m=self._before_m,
            )
        )
        return True

    def _begin(self, grip_id: int, width_m: float, now_ns: int) -> None:
        channel = self._channel
        self._grip_id, self._before_m = grip_id, width_m
        self._cancelled = self._must_hold(now_ns)
        if self._cancelled:
            return
        kind = channel[Word.GRIP_KIND]
        target_m, force_n = channel[Word.GRIP_WIDTH_UM] / 1e6, channel[Word.GRIP_FORCE_MN] / 1e3

        def call() -> None:
            if kind == GripKind.HOME:
                self._gripper.homing()
            elif kind == GripKind.GRASP:
                self._gripper.grasp(target_m, SPEED_M_S, force_n, ANY_WIDTH_M, ANY_WIDTH_M)
            else:
                self._gripper.move(target_m, SPEED_M_S)

        self._running, self._began_ns, self._moved_ns = True, now_ns, now_ns
        self._beside(call, grip_id)

    def _beside(self, call: Callable[[], object], grip_id: int) -> None:
        """Run a blocking call of the gripper; its result is unreliable, so the width decides how it ended."""

        def run() -> None:
            try:
                call()
            except Exception as error:
                print(f"the gripper said: {error}", file=sys.stderr)
            self._returned.add(grip_id)

        self._start(run)

    def _look(self, now_ns: int) -> None:
        late = now_ns - self._began_ns > LONGEST_S * 1e9
        if not self._cancelled and (late or self._must_hold(now_ns)):
            self._beside(self._gripper.stop, self._grip_id)
            self._cancelled = True
            self._moved_ns = now_ns
        still = now_ns - self._moved_ns > STILL_S * 1e9
        # A stopped call may never return.
        if still and (self._cancelled or self._grip_id in self._returned):
            self._running = False

    def _must_hold(self, now_ns: int) -> bool:
        channel = self._channel
        late = now_ns - channel[Word.DRIVER_BEAT_NS] > channel[Word.LEASE_NS]
        ordered = channel[Word.HOLD_ID] >= self._grip_id or channel[Word.LATCH] or channel[Word.CLOSE]
        return bool(ordered) or late or not self._parent_alive()


def _fingers(address: str, arm: str) -> FingerCommands:
    if arm == PANDA:
        return FrankaRsFingers(address)
    franky: Any = importlib.import_module("franky")
    return franky.Gripper(address)


def main(arguments: list[str]) -> int:
    """Run with the channel's file, the arm's address and its model's name; 1 if the gripper is lost."""
    file, address, arm = arguments
    parent = os.getppid()
    with Channel(Path(file)) as channel:
        try:
            gripper = _fingers(address, arm)
            loop = HandLoop(
                channel,
                gripper,
                lambda: os.getppid() == parent,
                lambda call: threading.Thread(target=call, daemon=True).start(),
            )
            while loop.turn(time.monotonic_ns()):
                time.sleep(PERIOD_S)
        except Exception as error:  # of the library, or the library itself is missing
            print(f"the gripper is lost: {error}", file=sys.stderr)
            return 1
    return 0


if __name__ == "__main__":
    os._exit(main(sys.argv[1:]))  # a stopped call of the library may never return
