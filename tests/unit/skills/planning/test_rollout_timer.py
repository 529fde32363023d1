"""When a search ends, by a clock that is set by hand."""

import pytest

from dlokit.skills.planning.rollout.search import Timer


class HandClock:
    """A stopwatch that the test advances."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


def _play(timer: Timer, clock: HandClock, rollouts: int, each_s: float) -> None:
    with timer.simulating(rollouts):
        clock.now_s += rollouts * each_s


def test_without_a_clock_nothing_is_skipped() -> None:
    timer = Timer(0.001, None)
    timer.allow(0.0, 8, 8)
    with timer.simulating(1000):
        pass
    assert not timer.over
    assert timer.batch(480) == 480
    assert list(timer.rounds([1, 2, 3], 8)) == [[1, 2, 3]]


def test_the_time_for_a_part_ends_and_the_next_part_gets_more() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    timer.allow(0.5, 0, 8)
    _play(timer, clock, 10, 0.11)
    assert timer.over
    timer.allow(1.0, 0, 8)
    assert not timer.over


def test_time_is_reserved_for_the_finals_at_the_pace_of_simulation_alone() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    clock.now_s += 1.0  # candidates were made
    _play(timer, clock, 10, 0.01)
    timer.allow(1.0, 5, 8)  # three parts of two finalists, 0.48 s
    clock.now_s += 0.4
    assert not timer.over  # 1.50 of 1.52 s
    clock.now_s += 0.1
    assert timer.over


def test_long_finals_leave_the_search_its_minimum_time() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    _play(timer, clock, 100, 0.013)  # 1.3 s; a part of the finals takes 0.21 s, all of them 0.83 s
    timer.allow(1.0, 8, 8)
    assert not timer.over  # up to 1.4 s


def test_if_no_finals_would_end_in_time_the_search_has_all_of_it() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    _play(timer, clock, 18, 0.1)
    timer.allow(1.0, 8, 8)
    assert not timer.over
    assert list(timer.rounds([1, 2, 3], 8)) == []


def test_batches_are_small_until_the_pace_is_known() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    assert timer.batch(100) == 2
    _play(timer, clock, 2, 0.2)
    assert timer.batch(100) == 2  # slow
    _play(timer, clock, 400, 0.001)
    assert timer.batch(100) == 16  # quick
    assert timer.batch(3) == 3


def test_finals_are_simulated_while_the_next_one_will_end_in_time() -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2)
    _play(timer, clock, 130, 0.01)  # 1.3 s; two finalists on eight rods take 0.16 s
    shown = list[int]()
    for some in timer.rounds(list(range(100)), 8):
        _play(timer, clock, 8 * len(some), 0.01)
        shown += some
    assert shown == list(range(8))
    assert clock.now_s - 100.0 == pytest.approx(1.94)


def test_something_is_simulated_even_if_the_time_is_over_before() -> None:
    clock = HandClock()
    timer = Timer(1.0, clock, cores=2)
    clock.now_s += 5.0
    timer.allow(0.0, 0, 8)
    assert not timer.over
    assert timer.batch(3) == 2


@pytest.mark.parametrize(
    ("each_s", "ends_s"), [(0.01, 2.0), (0.04, 4.0), (0.5, 6.0)], ids=["quick", "busy", "hopeless"]
)
def test_on_a_busy_machine_a_decision_takes_as_long_as_the_least_rollouts_but_no_more_than_three_times(
    each_s: float, ends_s: float
) -> None:
    clock = HandClock()
    timer = Timer(2.0, clock, cores=2, least=100)
    timer.allow(1.0, 0, 8)
    while not timer.over:
        _play(timer, clock, 1, each_s)
    assert clock.now_s - 100.0 == pytest.approx(ends_s, abs=each_s)
