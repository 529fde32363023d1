"""The streaming process turn by turn, on an arm that follows its set-points exactly or not at all."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dlokit.description.arm.franka import FR3
from dlokit.extras.franka.channel import (
    Channel,
    Latch,
    MotionEnding,
    Samples,
    StreamPhase,
    StreamState,
    Word,
)
from dlokit.extras.franka.link import LinkLost, Reading
from dlokit.extras.franka.reflexes import NAMES, ArmMode
from dlokit.extras.franka.stream import GUARD_SILENCE_S, STALLED_S, TRACKING_RAD, Limits, Streamer
from dlokit.motion.limits import scaled
from dlokit.motion.trajectories import joint_move
from dlokit.types.arrays import Float64Array
from dlokit.types.robot import JointTrajectory

SECOND = 1_000_000_000
TURN_NS = 2_000_000
LEASE_NS = SECOND // 5
MOVE = joint_move(FR3.home_q_rad, FR3.home_q_rad + 0.3, FR3.limits)
LIMITS = Limits(
    velocity=FR3.limits.velocity_rad_s,
    acceleration=FR3.limits.acceleration_rad_s2,
    jerk=FR3.limits.jerk_rad_s3,
)


class FakeLink:
    """An arm whose clock runs with the lab's."""

    def __init__(self) -> None:
        self.ms = 1000
        self.q: Float64Array = FR3.home_q_rad.copy()
        self.dq: Float64Array = np.zeros(7)
        self.mode = ArmMode.IDLE
        self.in_control = False
        self.follows = True
        self.sag = 0.0
        self.word = 0
        self.recoverable = True
        self.recoveries = 0
        self.ahead_s = 0.002
        self.targets: list[tuple[int, Float64Array, Float64Array]] = []

    def read(self) -> Reading:
        return Reading(
            robot_ms=self.ms,
            mode=self.mode,
            q=self.q,
            dq=self.dq,
            tau=np.zeros(7),
            wrench=np.zeros(6),
            T_base_tool=np.eye(4),
            T_flange_tool=np.eye(4),
            tool_kg=0.73,
            load_kg=0.0,
        )

    def begin(self) -> None:
        self.in_control, self.mode = True, ArmMode.MOVE

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        self.targets.append((self.ms, q, dq))
        if self.follows:
            self.q, self.dq = q - self.sag, dq

    def end(self) -> None:
        self.in_control, self.mode = False, ArmMode.IDLE

    def errors(self) -> int:
        return self.word

    def recover(self) -> bool:
        self.recoveries += 1
        if self.recoverable:
            self.mode, self.word = ArmMode.IDLE, 0
        return self.recoverable

    def reflex(self, name: str) -> None:
        """The arm stops itself."""
        self.word, self.mode, self.in_control = 1 << NAMES.index(name), ArmMode.REFLEX, False
        self.dq = np.zeros(7)


class Lab:
    def __init__(self, channel: Channel) -> None:
        self.channel, self.link = channel, FakeLink()
        self.parent = self.beats = self.guarded = True
        self.now_ns = SECOND
        channel[Word.LEASE_NS] = LEASE_NS
        self.streamer = Streamer(channel, self.link, LIMITS, lambda: self.parent)

    def post(self, trajectory: JointTrajectory = MOVE) -> None:
        samples = Samples(
            times=trajectory.times_s.tobytes(), q=trajectory.q_rad.tobytes(), dq=trajectory.dq_rad_s.tobytes()
        )
        self.channel.post(samples, self.channel[Word.FOLLOW_ID] + 1)

    def run(self, seconds: float, clock: float = 1.0) -> StreamState:
        """Let time pass; the arm's clock runs `clock` times as fast as the machine's."""
        for _ in range(round(seconds * SECOND / TURN_NS)):
            self.now_ns += TURN_NS
            self.link.ms += round(clock * TURN_NS / 1e6)
            if self.beats:
                self.channel[Word.DRIVER_BEAT_NS] = self.now_ns
            if self.guarded:
                self.channel[Word.GUARD_BEAT_NS] = self.now_ns
            if not self.streamer.turn(self.now_ns):
                break
        state = self.channel.read_state()
        assert state is not None
        return state


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with Channel(tmp_path / "arm") as channel:
        lab = Lab(channel)
        lab.run(0.01)
        yield lab


def test_a_trajectory_is_followed_to_its_end_and_the_arm_then_holds_itself(lab: Lab) -> None:
    lab.post()
    state = lab.run(float(MOVE.times_s[-1]) + 0.1)
    assert (state.motion_id, state.ending, state.phase) == (1, MotionEnding.ARRIVED, StreamPhase.IDLE)
    np.testing.assert_allclose(state.q, MOVE.q_rad[-1], atol=1e-9)
    assert state.took_s == pytest.approx(float(MOVE.times_s[-1]), abs=0.02)
    assert not lab.link.in_control
    assert lab.channel[Word.STREAM_SILENCE_NS] == 0


@pytest.mark.parametrize("clock", [0.5, 4.0])
def test_set_points_are_those_of_the_arms_time_however_fast_it_passes(lab: Lab, clock: float) -> None:
    lab.post()
    lab.run(2.0 * float(MOVE.times_s[-1]) / clock, clock)
    began_ms = lab.link.targets[0][0]
    # The first set-point comes a turn after the start; each is 2 ms ahead of the state that it answers.
    ahead_s = clock * TURN_NS / SECOND + 0.002
    for ms, q, dq in lab.link.targets:
        at_s = (ms - began_ms) / 1e3 + ahead_s
        for got, samples, off in ((q, MOVE.q_rad, 6e-3), (dq, MOVE.dq_rad_s, 3e-2)):  # corrected by 5 mrad at most
            expected = [np.interp(at_s, MOVE.times_s, joint) for joint in samples.T]
            np.testing.assert_allclose(got, expected, atol=off)


def test_the_guardian_may_kill_it_in_a_motion_only(lab: Lab) -> None:
    assert lab.channel[Word.STREAM_SILENCE_NS] == 0
    lab.post()
    lab.run(0.1)
    assert lab.channel[Word.STREAM_SILENCE_NS] == SECOND // 10
    lab.run(1.0)
    assert lab.channel[Word.STREAM_SILENCE_NS] == 0


@pytest.mark.parametrize(
    ("fault", "ending"),
    [
        ("brake", MotionEnding.BRAKED),
        ("latch", MotionEnding.BRAKED),
        ("close", MotionEnding.BRAKED),
        ("heartbeat", MotionEnding.LEASE),
        ("parent", MotionEnding.LEASE),
        ("guardian", MotionEnding.UNGUARDED),
    ],
)
def test_it_brakes_on_the_path_by_itself(lab: Lab, fault: str, ending: MotionEnding) -> None:
    lab.post(scaled(joint_move(FR3.home_q_rad, FR3.home_q_rad + 1.2, FR3.limits), 0.5))
    lab.run(0.2)
    match fault:
        case "brake":
            lab.channel[Word.BRAKE_ID] = 1
        case "latch":
            lab.channel[Word.LATCH] = Latch.PERSON
        case "close":
            lab.channel[Word.CLOSE] = 1
        case "heartbeat":
            lab.beats = False
        case "parent":
            lab.parent = False
        case _:
            lab.guarded = False
            lab.run(GUARD_SILENCE_S - 0.05)
    state = lab.run(0.002)
    while state.ending == MotionEnding.NONE:
        state = lab.run(0.002)
    assert (state.ending, state.phase) == (ending, StreamPhase.IDLE)
    line = (np.array(state.q) - FR3.home_q_rad) / 1.2  # all joints move alike
    np.testing.assert_allclose(line, line[0], atol=1e-6)
    assert 0.01 < line[0] < 0.99
    assert np.abs(state.dq).max() < 0.01


def test_a_motion_is_refused_while_the_driver_is_silent_and_begins_with_its_next_one(lab: Lab) -> None:
    lab.beats = False
    lab.run(0.3)
    lab.post()
    assert lab.run(0.01).ending == MotionEnding.LEASE
    assert lab.link.targets == []
    lab.beats = True
    lab.run(0.01)
    lab.post()
    assert lab.run(0.01).phase == StreamPhase.MOVING


def test_a_motion_that_was_braked_before_it_began_does_not_begin(lab: Lab) -> None:
    lab.channel[Word.BRAKE_ID] = 1
    lab.post()
    state = lab.run(0.01)
    assert (state.motion_id, state.ending) == (1, MotionEnding.BRAKED)
    assert lab.link.targets == []


def test_a_damaged_trajectory_is_not_begun(lab: Lab) -> None:
    lab.post()
    lab.channel[Word.FOLLOW_SUM] += 1
    assert lab.run(0.01).ending == MotionEnding.DAMAGED
    assert lab.link.targets == []


def test_an_arm_that_does_not_follow_is_braked(lab: Lab) -> None:
    lab.link.follows = False
    lab.post()
    state = lab.run(1.5)
    assert state.ending == MotionEnding.TRACKING
    assert TRACKING_RAD < state.largest_error_rad < 1.2 * TRACKING_RAD
    assert np.abs(lab.link.targets[-1][1] - FR3.home_q_rad).max() < 1.2 * TRACKING_RAD  # and pushes no further


@pytest.mark.parametrize(
    ("name", "latch"),
    [
        ("communication_constraints_violation", Latch.NONE),
        ("tau_j_range_violation", Latch.NONE),
        ("cartesian_reflex", Latch.COLLISION),
    ],
)
def test_a_reflex_is_named_and_a_collision_latches(lab: Lab, name: str, latch: Latch) -> None:
    lab.post()
    lab.run(0.1)
    lab.link.reflex(name)
    state = lab.run(0.01)
    assert (state.ending, state.phase) == (MotionEnding.ARM, StreamPhase.FAULT)
    assert state.errors == 1 << NAMES.index(name)
    assert lab.channel[Word.LATCH] == latch
    lab.channel[Word.LATCH] = Latch.NONE
    lab.post()
    assert lab.run(0.01).ending == MotionEnding.REFUSED
    lab.channel[Word.RECOVER_ID] += 1
    states = [lab.run(0.002) for _ in range(5) if lab.channel[Word.RECOVERED_ID] != lab.channel[Word.RECOVER_ID]]
    assert lab.channel[Word.RECOVERED_ID] == lab.channel[Word.RECOVER_ID]
    # The driver looks at the state when it hears that it recovered, and must not see an older one.
    assert (states[-1].phase, states[-1].mode) == (StreamPhase.IDLE, ArmMode.IDLE)
    assert lab.link.recoveries == 1


def test_an_arm_that_cannot_recover_says_so_and_stays_in_fault(lab: Lab) -> None:
    lab.post()
    lab.run(0.1)
    lab.link.reflex("tau_j_range_violation")
    lab.link.recoverable = False
    lab.run(0.01)
    lab.channel[Word.RECOVER_ID] += 1
    state = lab.run(0.02)
    assert lab.channel[Word.RECOVERED_ID] == lab.channel[Word.RECOVER_ID]
    assert (state.phase, state.mode) == (StreamPhase.FAULT, ArmMode.REFLEX)
    assert lab.link.recoveries == 1


@pytest.mark.parametrize(("mode", "latch"), [(ArmMode.USER_STOPPED, Latch.USER_STOP), (ArmMode.GUIDING, Latch.GUIDING)])
def test_a_persons_hand_on_the_arm_latches_at_any_time(lab: Lab, mode: ArmMode, latch: Latch) -> None:
    lab.link.mode = mode
    lab.run(0.01)
    assert lab.channel[Word.LATCH] == latch


def test_a_persons_stop_keeps_its_reason(lab: Lab) -> None:
    lab.channel[Word.LATCH] = Latch.PERSON
    lab.link.mode = ArmMode.USER_STOPPED
    lab.run(0.01)
    assert lab.channel[Word.LATCH] == Latch.PERSON


def test_an_arm_whose_clock_stands_still_is_lost(lab: Lab) -> None:
    lab.post()
    lab.run(0.1)
    lab.run(STALLED_S - 0.01, clock=0.0)
    with pytest.raises(LinkLost, match="has not advanced"):
        lab.run(0.05, clock=0.0)


def test_a_motion_of_an_earlier_driver_is_not_begun(lab: Lab) -> None:
    lab.post()
    lab.streamer = Streamer(lab.channel, lab.link, LIMITS, lambda: True)
    lab.run(0.1)
    assert lab.link.targets == []


@pytest.mark.parametrize("orphaned", [True, False])
def test_it_ends_at_rest_when_the_driver_closes_or_dies(lab: Lab, orphaned: bool) -> None:
    lab.post()
    lab.run(0.1)
    lab.parent, lab.channel[Word.CLOSE] = not orphaned, not orphaned
    lab.run(0.05)
    for _ in range(1000):
        lab.now_ns += TURN_NS
        lab.link.ms += 2
        if not lab.streamer.turn(lab.now_ns):
            break
    else:
        pytest.fail("it did not end")
    assert not lab.link.in_control
    assert np.abs(lab.link.dq).max() < 0.01


def test_an_arm_that_sags_comes_to_its_set_points_and_the_next_motion_begins_there(lab: Lab) -> None:
    lab.link.sag = 0.004
    lab.post()
    state = lab.run(2.0)
    assert state.ending == MotionEnding.ARRIVED
    assert np.abs(np.array(state.q) - MOVE.q_rad[-1]).max() <= 0.001
    lab.post(joint_move(MOVE.q_rad[-1], FR3.home_q_rad, FR3.limits))
    state = lab.run(2.0)
    assert state.largest_error_rad < 0.0015


def test_a_set_point_is_corrected_by_five_milliradians_at_most(lab: Lab) -> None:
    lab.link.sag = 0.05
    lab.post()
    lab.run(2.0)
    assert lab.link.targets[-1][1] == pytest.approx(MOVE.q_rad[-1] + 0.005)
