"""The hand: judged by its width, stopped in time, whatever the library raises or returns."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from dlokit.extras.franka.channel import Channel, GripKind, HandState, Latch, Word
from dlokit.extras.franka.hand import LONGEST_S, FingerVerdict, HandLoop, judged

SECOND = 1_000_000_000
STEP_NS = 10_000_000
LEASE_NS = SECOND // 5


@pytest.mark.parametrize(
    ("target_m", "before_m", "width_m", "expected"),
    [
        (0.0, 0.08, 0.008, FingerVerdict(held=True)),
        (0.0, 0.08, 0.0016, FingerVerdict()),
        (0.0, 0.008, 0.008, FingerVerdict(held=True)),  # it held the rope before
        (0.03, 0.08, 0.0301, FingerVerdict()),
        (0.03, 0.08, 0.05, FingerVerdict(held=True)),
        (0.04, 0.008, 0.0399, FingerVerdict()),
        (0.04, 0.008, 0.012, FingerVerdict(jammed=True)),
    ],
)
def test_the_width_tells_what_became_of_the_fingers(
    target_m: float, before_m: float, width_m: float, expected: FingerVerdict
) -> None:
    assert judged(target_m, before_m, width_m) == expected


@dataclass
class State:
    width: float
    max_width: float = 0.08


class FakeGripper:
    """Fingers at 0.1 m/s with something between them; its calls return when the test says so."""

    def __init__(self) -> None:
        self.state = State(0.08)
        self.goal_m = 0.08
        self.object_m = 0.0
        self.calls: list[tuple[str, float]] = []
        self.error: Exception | None = None

    def step(self, seconds: float) -> None:
        way = self.goal_m - self.state.width
        self.state.width += max(-0.1 * seconds, min(0.1 * seconds, way))
        self.state.width = max(self.state.width, self.object_m)

    def move(self, width: float, speed: float) -> bool:
        return self._go("move", width)

    def grasp(self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float) -> bool:
        return self._go("grasp", width)

    def homing(self) -> bool:
        return self._go("homing", 0.08)

    def stop(self) -> bool:
        return self._go("stop", self.state.width)

    def _go(self, name: str, goal_m: float) -> bool:
        self.calls.append((name, goal_m))
        self.goal_m = goal_m
        if self.error is not None:
            raise self.error
        return False


class Lab:
    def __init__(self, channel: Channel) -> None:
        self.channel, self.gripper = channel, FakeGripper()
        self.pending: list[Callable[[], None]] = []
        self.now_ns = SECOND
        self.beats = True
        channel[Word.LEASE_NS] = LEASE_NS
        self.loop = HandLoop(channel, self.gripper, lambda: True, self.pending.append)

    def order(self, kind: GripKind, width_m: float) -> int:
        self.channel[Word.GRIP_KIND], self.channel[Word.GRIP_WIDTH_UM] = kind, round(1e6 * width_m)
        self.channel[Word.GRIP_ID] += 1
        return self.channel[Word.GRIP_ID]

    def run(self, seconds: float) -> HandState:
        for _ in range(round(seconds * SECOND / STEP_NS)):
            self.now_ns += STEP_NS
            if self.beats:
                self.channel[Word.DRIVER_BEAT_NS] = self.now_ns
            assert self.loop.turn(self.now_ns)
            while self.pending:
                self.pending.pop(0)()
            self.gripper.step(STEP_NS / SECOND)
        state = self.channel.read_hand()
        assert state is not None
        return state


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with Channel(tmp_path / "arm") as channel:
        yield Lab(channel)


@pytest.mark.parametrize("error", [None, RuntimeError("libfranka gripper: Command failed!")])
def test_a_grasp_that_the_library_calls_failed_ends_with_the_measured_width(lab: Lab, error: Exception | None) -> None:
    lab.gripper.object_m, lab.gripper.error = 0.008, error
    grip_id = lab.order(GripKind.GRASP, 0.0)
    state = lab.run(2.0)
    assert (state.grip_id, state.running, state.cancelled) == (grip_id, 0, 0)
    assert state.width_m == pytest.approx(0.008)
    assert judged(0.0, state.before_m, state.width_m).held


def test_fingers_still_on_their_way_are_waited_for_although_the_call_has_returned(lab: Lab) -> None:
    lab.order(GripKind.MOVE, 0.0)
    assert lab.run(0.6).running
    assert not lab.run(1.0).running


def test_fingers_stop_when_the_heartbeat_is_missing_and_the_next_order_may_follow(lab: Lab) -> None:
    lab.order(GripKind.MOVE, 0.0)
    lab.run(0.1)
    lab.beats = False
    state = lab.run(1.0)
    assert (state.running, state.cancelled) == (0, 1)
    assert 0.03 < state.width_m < 0.06
    assert lab.gripper.calls[-1][0] == "stop"
    lab.beats = True
    lab.order(GripKind.MOVE, 0.08)
    state = lab.run(1.5)
    assert (state.running, state.cancelled) == (0, 0)
    assert state.width_m == pytest.approx(0.08)


@pytest.mark.parametrize("word", [Word.LATCH, Word.HOLD_ID])
def test_fingers_stop_at_an_order_and_are_refused_while_it_stands(lab: Lab, word: Word) -> None:
    grip_id = lab.order(GripKind.MOVE, 0.0)
    lab.run(0.2)
    lab.channel[word] = Latch.PERSON if word is Word.LATCH else grip_id
    stopped = lab.run(1.0)
    assert (stopped.running, stopped.cancelled) == (0, 1)
    assert 0.04 < stopped.width_m < 0.07
    later = lab.order(GripKind.MOVE, 0.0)
    refused = lab.run(1.0)
    if word is Word.LATCH:
        assert (refused.grip_id, refused.cancelled, refused.width_m) == (later, 1, stopped.width_m)
    else:
        assert (refused.grip_id, refused.cancelled) == (later, 0)


def test_a_call_that_never_returns_is_given_up(lab: Lab) -> None:
    lab.loop = HandLoop(lab.channel, lab.gripper, lambda: True, lambda call: None)
    lab.order(GripKind.MOVE, 0.0)
    assert lab.run(LONGEST_S).running
    state = lab.run(1.0)
    assert (state.running, state.cancelled) == (0, 1)


def test_a_grip_of_an_earlier_driver_is_not_begun(lab: Lab) -> None:
    lab.order(GripKind.MOVE, 0.0)
    lab.loop = HandLoop(lab.channel, lab.gripper, lambda: True, lab.pending.append)
    lab.run(0.5)
    assert lab.gripper.calls == []


def test_it_ends_at_the_order(lab: Lab) -> None:
    lab.run(0.1)
    lab.channel[Word.CLOSE] = 1
    assert not lab.loop.turn(lab.now_ns)
