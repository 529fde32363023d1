"""The set-points for the states of a recorded motion of franky-sim's arm are those of the recording."""

from pathlib import Path

import numpy as np
from franka_exchange import MOVE, RecordedTurn, read_exchange

from dlokit.description.arm.franka import FR3
from dlokit.extras.franka.channel import Channel, MotionEnding, Samples, Word
from dlokit.extras.franka.link import Reading
from dlokit.extras.franka.reflexes import ArmMode
from dlokit.extras.franka.stream import Limits, Streamer
from dlokit.types.arrays import Float64Array

LARGEST_ERROR_RAD = 0.02
"""The bar of tracking at 0.3 of the limits; the recording runs at 0.5."""


class PlayedLink:
    """Reads the recorded states, and keeps the set-points."""

    ahead_s = 0.002

    def __init__(self, turns: list[RecordedTurn]) -> None:
        self._turns = iter(turns)
        self.turn = turns[0]
        self.started = self.ended = False
        self.set: list[tuple[RecordedTurn, Float64Array, Float64Array]] = []

    def read(self) -> Reading:
        self.turn = next(self._turns)
        zeros = np.zeros(7)
        return Reading(
            self.turn.robot_ms,
            self.turn.mode,
            self.turn.q,
            self.turn.dq,
            zeros,
            zeros[:6],
            np.eye(4),
            np.eye(4),
            0.7,
            0,
        )

    def begin(self) -> None:
        self.started = True

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        self.set.append((self.turn, q, dq))

    def end(self) -> None:
        self.ended = True

    @property
    def in_control(self) -> bool:
        return self.started and not (self.ended and self.turn.mode == ArmMode.IDLE)

    def errors(self) -> int:
        return 0

    def recover(self) -> bool:
        return True


def test_a_recorded_motion_is_answered_with_the_same_set_points(tmp_path: Path) -> None:
    turns = read_exchange()
    link = PlayedLink(turns)
    limits = Limits(
        velocity=FR3.limits.velocity_rad_s,
        acceleration=FR3.limits.acceleration_rad_s2,
        jerk=FR3.limits.jerk_rad_s3,
    )
    with Channel(tmp_path / "arm") as channel:
        channel[Word.LEASE_NS] = 10**12
        streamer = Streamer(channel, link, limits, lambda: True)
        samples = Samples(times=MOVE.times_s.tobytes(), q=MOVE.q_rad.tobytes(), dq=MOVE.dq_rad_s.tobytes())
        channel.post(samples, 1)
        for now_ns in range(0, len(turns) * 2_000_000, 2_000_000):
            channel[Word.DRIVER_BEAT_NS] = channel[Word.GUARD_BEAT_NS] = now_ns
            streamer.turn(now_ns)
        state = channel.read_state()
    assert state is not None
    assert state.ending == MotionEnding.ARRIVED
    assert len(link.set) == sum(bool(np.isfinite(turn.target_q[0])) for turn in turns) > 200
    for turn, q, dq in link.set:
        np.testing.assert_allclose(q, turn.target_q, atol=1e-12)
        np.testing.assert_allclose(dq, turn.target_dq, atol=1e-12)
    assert 0.0 < state.largest_error_rad < LARGEST_ERROR_RAD
    assert state.took_s < float(MOVE.times_s[-1]) + 0.35
