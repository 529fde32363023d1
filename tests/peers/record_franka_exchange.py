"""Records states of franky-sim's arm and the set-points that answered them, for a test that needs no simulator.

python tests/peers/record_franka_exchange.py, after an intended change of sampling or pacing.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1]
sys.path[:0] = [str(TESTS / "helpers"), str(TESTS.parent / "benchmarks")]

from franka_exchange import FILE, MOVE, RecordedTurn, write_exchange  # noqa: E402
from franky_server import FrankyServer  # noqa: E402

from dlokit.description.arm.franka import FR3  # noqa: E402
from dlokit.extras.franka.channel import Channel, MotionEnding, Samples, Word  # noqa: E402
from dlokit.extras.franka.link import FrankyLink, Protection, Reading  # noqa: E402
from dlokit.extras.franka.stream import TURN_S, Limits, Streamer  # noqa: E402
from dlokit.types.arrays import Float64Array  # noqa: E402


class RecordingLink(FrankyLink):
    """Keeps what was read and what was set."""

    def __init__(self, address: str, protection: Protection) -> None:
        super().__init__(address, protection, real_time=False)
        self.turns: list[RecordedTurn] = []

    def read(self) -> Reading:
        reading = super().read()
        self.turns.append(RecordedTurn(reading.robot_ms, reading.mode, np.array(reading.q), np.array(reading.dq)))
        return reading

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        super().target(q, dq)
        self.turns[-1] = self.turns[-1]._replace(target_q=q.copy(), target_dq=dq.copy())


def main() -> None:
    """Record one motion."""
    with (
        tempfile.TemporaryDirectory() as folder,
        FrankyServer(Path(folder)) as server,
        Channel(Path(folder) / "arm") as channel,
    ):
        link = RecordingLink(server.address, Protection(torque_nm=20, force_n=30, load_kg=0, load_at_m=(0, 0, 0)))
        limits = FR3.limits
        streamer = Streamer(
            channel,
            link,
            Limits(velocity=limits.velocity_rad_s, acceleration=limits.acceleration_rad_s2, jerk=limits.jerk_rad_s3),
            lambda: True,
        )
        channel[Word.LEASE_NS] = 10**10
        samples = Samples(times=MOVE.times_s.tobytes(), q=MOVE.q_rad.tobytes(), dq=MOVE.dq_rad_s.tobytes())
        channel[Word.DRIVER_BEAT_NS] = time.monotonic_ns()
        channel.post(samples, 1)
        while (state := channel.read_state()) is None or state.ending == MotionEnding.NONE:
            channel[Word.GUARD_BEAT_NS] = time.monotonic_ns()
            streamer.turn(time.monotonic_ns())
            time.sleep(TURN_S)
        assert state.ending == MotionEnding.ARRIVED
    write_exchange(link.turns)
    print(f"{len(link.turns)} turns, largest error {1e3 * state.largest_error_rad:.1f} mrad: {FILE}")


if __name__ == "__main__":
    main()
