"""The streaming process: the only process that commands the arm. It has no other task, and imports little.

It follows a posted trajectory by the arm's own clock: on a busy machine the set-points are sent late, but they fit the
time at which they are sent. It brakes on its own when the driver's heartbeat is too old, when the guardian is silent,
or when a stop is latched, so that the arm stops without any other process.

    python -m dlokit.extras.franka.stream FILE SETTINGS
"""

import contextlib
import gc
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dlokit.extras.franka.channel import (
    Channel,
    Latch,
    MotionEnding,
    StreamPhase,
    StreamState,
    Word,
    write_urdf,
)
from dlokit.extras.franka.link import FrankyLink, Link, LinkLost, Protection, Reading
from dlokit.extras.franka.panda_link import ARM as PANDA
from dlokit.extras.franka.panda_link import FrankaRsLink
from dlokit.extras.franka.reflexes import ArmMode, latch_of
from dlokit.extras.franka.sampling import Course, Trim
from dlokit.types.arrays import Float64Array

TURN_S = 0.002
"""Time between two set-points [s]."""
SILENCE_S = 0.1
"""Longest turn of this process during a motion [s]; the guardian kills a longer one."""
_START_SILENCE_S = 1.0
"""The same while the arm starts or ends its control mode [s]."""
GUARD_SILENCE_S = 0.5
"""A guardian's heartbeat older than this [s] brakes a motion, and prevents a new one."""
STALLED_S = 0.8
"""If the arm's clock does not advance within this time [s], the connection is lost."""
TRACKING_RAD = 0.08
"""Largest distance of a joint from its set-point [rad]; at the joints' acceleration limits it reaches 0.05. Beyond
it, the arm pushes against an obstacle, or the machine is too busy, and the arm stops."""
_SETTLED_RAD_S = 0.01
_SETTLED_RAD = 0.001
_LONGEST_SETTLE_S = 0.3
"""Longest time for an arm to come to rest at its set-points after the end of its path [s]."""
_LONGEST_END_S = 1.0
PRIORITY = 30
"""Real-time priority of this process and of the control thread that it starts, where the system allows one."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The joint limits (7,) for braking."""

    velocity: Float64Array
    acceleration: Float64Array
    jerk: Float64Array


class Streamer:
    """The states of the streaming process, one turn at a time."""

    def __init__(self, channel: Channel, link: Link, limits: Limits, parent_alive: Callable[[], bool]) -> None:
        """`parent_alive` returns whether the driver's process lives."""
        self._channel, self._link, self._limits = channel, link, limits
        self._parent_alive = parent_alive
        self._phase = StreamPhase.IDLE
        self._course: Course | None = None
        self._trim = Trim()
        self._motion_id = channel[Word.FOLLOW_ID]  # a motion of an earlier driver is over
        self._recovered_id = channel[Word.RECOVERED_ID]
        self._ending, self._wanted_ending = MotionEnding.NONE, MotionEnding.NONE
        self._errors = self._turns = 0
        self._largest_rad = self._sum_rad = self._took_s = 0.0
        self._last: Reading | None = None
        self._last_set: Float64Array | None = None
        self._new_ns = self._began_ms = self._rest_ms = 0
        self._left_control_ns = 0

    def turn(self, now_ns: int) -> bool:
        """One turn; False at the end. `now_ns` is the machine's monotonic clock. Raises `LinkLost`."""
        channel = self._channel
        channel[Word.STREAM_BEAT_NS] = now_ns
        reading = self._link.read()
        if self._last is None or reading.robot_ms != self._last.robot_ms:
            passed_ms = 0 if self._last is None else reading.robot_ms - self._last.robot_ms
            self._last, self._new_ns = reading, now_ns
            self._watch_mode(reading)
            if self._course is not None:
                self._move(self._course, reading, passed_ms / 1e3, now_ns)
            self._publish(reading, now_ns)
        elif now_ns - self._new_ns > STALLED_S * 1e9:
            raise LinkLost(f"the arm's clock has not advanced for {STALLED_S} s: is the network cut?")
        if self._course is None:
            if channel[Word.CLOSE] or not self._parent_alive():
                return False
            self._at_rest(reading, now_ns)
        return True

    def _at_rest(self, reading: Reading, now_ns: int) -> None:
        channel = self._channel
        asked = channel[Word.RECOVER_ID]
        if asked != channel[Word.RECOVERED_ID]:
            if self._recovered_id == asked:  # a turn ago; the state since then, with the settings, is published
                channel[Word.RECOVERED_ID] = asked
                return
            if self._link.recover():
                self._phase, self._errors = StreamPhase.IDLE, 0
            self._recovered_id = asked
            self._last = None  # so that the next state is published, even one of the same millisecond
        elif (wanted := channel[Word.FOLLOW_ID]) > self._motion_id:
            self._begin(wanted, reading, now_ns)

    def _watch_mode(self, reading: Reading) -> None:
        """Latch the stop when a person guides the arm or presses its button, at any time."""
        if reading.mode in (ArmMode.USER_STOPPED, ArmMode.GUIDING):
            self._latch(latch_of(reading.mode, 0))

    def _latch(self, why: Latch) -> None:
        if why is not Latch.NONE and not self._channel[Word.LATCH]:
            self._channel[Word.LATCH] = why

    def _begin(self, motion_id: int, reading: Reading, now_ns: int) -> None:
        self._motion_id, self._ending = motion_id, MotionEnding.NONE
        self._turns = self._errors = 0
        self._largest_rad = self._sum_rad = self._took_s = 0.0
        refused = self._reason_to_brake(now_ns)
        if refused is None and (self._phase is not StreamPhase.IDLE or reading.mode != ArmMode.IDLE):
            refused = MotionEnding.REFUSED
        posted = self._channel.posted()
        if refused is None and posted is None:
            refused = MotionEnding.DAMAGED
        if refused is not None or posted is None:
            self._finish(refused or MotionEnding.DAMAGED, reading)
            return
        times, q, dq = (np.frombuffer(each) for each in (posted.times, posted.q, posted.dq))
        limits = self._limits
        self._course = Course(
            times,
            q.reshape(-1, 7),
            dq.reshape(-1, 7),
            np.array(reading.q),
            limits.velocity,
            limits.acceleration,
            limits.jerk,
        )
        self._wanted_ending = MotionEnding.ARRIVED
        self._phase = StreamPhase.MOVING
        self._began_ms, self._rest_ms, self._left_control_ns = reading.robot_ms, 0, 0
        self._last_set = None
        self._channel[Word.STREAM_SILENCE_NS] = round(_START_SILENCE_S * 1e9)
        self._link.begin()

    def _move(self, course: Course, reading: Reading, passed_s: float, now_ns: int) -> None:
        """One set-point."""
        self._turns += 1
        if not self._link.in_control:
            self._ended(reading)
            return
        if self._left_control_ns:
            if now_ns - self._left_control_ns > _LONGEST_END_S * 1e9:
                raise LinkLost("the arm did not leave its control mode")
            return
        course.advance(passed_s)
        if self._last_set is not None:
            off = course.setpoint()[0] - reading.q
            self._trim.learn(off, passed_s)
            off_rad = float(np.max(np.abs(off)))
            self._largest_rad = max(self._largest_rad, off_rad)
            self._sum_rad += off_rad
            if off_rad > TRACKING_RAD:
                # The path would lead further into the obstacle, so the arm releases its torques here.
                self._wanted_ending, self._phase = MotionEnding.TRACKING, StreamPhase.BRAKING
                self._leave_control(now_ns)
                return
        why = self._reason_to_brake(now_ns)
        if why is not None:
            self._brake(course, why)
        q, dq = course.setpoint(self._link.ahead_s)
        self._link.target(q + self._trim.rad, dq)
        self._last_set = q
        self._channel[Word.STREAM_SILENCE_NS] = round(SILENCE_S * 1e9)
        if course.finished:
            self._settle(course, reading, now_ns)

    def _settle(self, course: Course, reading: Reading, now_ns: int) -> None:
        self._phase = StreamPhase.HOLDING
        self._rest_ms = self._rest_ms or reading.robot_ms
        waited_s = (reading.robot_ms - self._rest_ms) / 1e3
        off_rad = float(np.max(np.abs(course.setpoint()[0] - reading.q)))
        # A braked arm only has to be at rest: it has no exact target.
        at_place = course.braking or off_rad < _SETTLED_RAD
        settled = at_place and float(np.max(np.abs(reading.dq))) < _SETTLED_RAD_S
        if settled or waited_s > _LONGEST_SETTLE_S:
            self._leave_control(now_ns)

    def _leave_control(self, now_ns: int) -> None:
        self._channel[Word.STREAM_SILENCE_NS] = round(_START_SILENCE_S * 1e9)
        self._left_control_ns = now_ns
        self._link.end()

    def _reason_to_brake(self, now_ns: int) -> MotionEnding | None:
        channel = self._channel
        if channel[Word.BRAKE_ID] >= self._motion_id or channel[Word.LATCH] or channel[Word.CLOSE]:
            return MotionEnding.BRAKED
        if now_ns - channel[Word.DRIVER_BEAT_NS] > channel[Word.LEASE_NS] or not self._parent_alive():
            return MotionEnding.LEASE
        if now_ns - channel[Word.GUARD_BEAT_NS] > GUARD_SILENCE_S * 1e9:
            return MotionEnding.UNGUARDED
        return None

    def _brake(self, course: Course, why: MotionEnding) -> None:
        if not course.braking:
            if not course.finished:  # else it has arrived
                self._wanted_ending = why
                self._phase = StreamPhase.BRAKING
            course.brake()

    def _ended(self, reading: Reading) -> None:
        """Handle the end of control, at our request or by the arm itself."""
        self._errors = self._link.errors()
        self._finish(self._wanted_ending if self._left_control_ns and not self._errors else MotionEnding.ARM, reading)

    def _finish(self, ending: MotionEnding, reading: Reading) -> None:
        self._channel[Word.STREAM_SILENCE_NS] = 0
        self._course, self._ending = None, ending
        if ending is MotionEnding.ARM:
            self._phase = StreamPhase.FAULT
            self._latch(latch_of(reading.mode, self._errors))
        elif self._phase in (StreamPhase.MOVING, StreamPhase.BRAKING, StreamPhase.HOLDING):
            self._phase = StreamPhase.IDLE
            self._took_s = (reading.robot_ms - self._began_ms) / 1e3
        self._publish(reading, self._new_ns)

    def _publish(self, reading: Reading, now_ns: int) -> None:
        self._channel.write_state(
            StreamState(
                read_ns=now_ns,
                robot_ms=reading.robot_ms,
                phase=self._phase,
                motion_id=self._motion_id,
                ending=self._ending,
                mode=reading.mode,
                errors=self._errors,
                turns=self._turns,
                largest_error_rad=self._largest_rad,
                mean_error_rad=self._sum_rad / max(self._turns, 1),
                took_s=self._took_s,
                q=tuple(reading.q),
                dq=tuple(reading.dq),
                tau=tuple(reading.tau),
                wrench=tuple(reading.wrench),
                T_base_tool=tuple(reading.T_base_tool.ravel()),
                T_flange_tool=tuple(reading.T_flange_tool.ravel()),
                tool_kg=reading.tool_kg,
                load_kg=reading.load_kg,
            )
        )


def run(channel: Channel, connect: Callable[[], Link], limits: Limits) -> None:
    """Connect, and run until the driver closes or dies. Raises `LinkLost`."""
    parent = os.getppid()
    link = connect()
    streamer = Streamer(channel, link, limits, lambda: os.getppid() == parent)
    gc.collect()
    gc.disable()  # a turn creates no reference cycles, and a collection would stop all threads
    while streamer.turn(time.monotonic_ns()):
        time.sleep(TURN_S)


def main(arguments: list[str]) -> int:
    """Run with the channel's file and the settings as JSON; 1 if the arm is lost, and the channel has the cause."""
    file, settings = arguments
    given = json.loads(settings)
    with contextlib.suppress(OSError, AttributeError):  # not allowed, or not Linux; threads inherit it
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(PRIORITY))

    def connected() -> Link:
        kind = FrankaRsLink if given["arm"] == PANDA else FrankyLink
        link = kind(given["address"], Protection(**given["protection"]), given["real_time"])
        write_urdf(Path(file), link.urdf)
        return link

    with Channel(Path(file)) as channel:
        try:
            run(
                channel,
                connected,
                Limits(**{name: np.array(row) for name, row in given["limits"].items()}),
            )
        except LinkLost as lost:
            channel.write_text(str(lost))
            return 1
        finally:
            channel[Word.STREAM_SILENCE_NS] = 0
    return 0


if __name__ == "__main__":
    # Skip the interpreter's shutdown: a control thread of the library may hang in it.
    os._exit(main(sys.argv[1:]))
