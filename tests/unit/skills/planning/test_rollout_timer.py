"""When a search ends, by a clock that is set by hand."""

import itertools

from dlokit.skills.planning.rollouts.timer import Timer


def test_without_a_clock_nothing_is_left_out() -> None:
    timer = Timer(0.001, None)
    timer.count(1000)
    timer.allow(0.0, 1000)
    assert list(timer.batches([1, 2, 3])) == [[1, 2, 3]]
    assert timer.affordable(8, 8) == 8


def test_with_a_clock_the_search_ends_in_time_and_keeps_some_for_its_finals() -> None:
    ticks = itertools.count(0.0, 0.1)
    now = [0.0]

    def stopwatch() -> float:
        return now[0]

    timer = Timer(2.0, stopwatch)
    played = 0
    timer.allow(1.0, 0)
    for batch in timer.batches(list(range(100_000))):
        now[0] = next(ticks)
        played += len(batch)
        timer.count(len(batch))
        timer.allow(1.0, played // 4)  # a quarter of what was played is still to come
    assert 0 < played < 100_000
    assert 1.4 <= now[0] <= 1.8  # 1.6 s, and a batch
    assert 1 <= timer.affordable(1000, played // 8) <= 2  # the quarter that is left, as eight parts


def test_something_is_played_even_when_the_time_is_over_before() -> None:
    timer = Timer(1.0, iter([0.0, 5.0, 5.0, 5.0, 5.0]).__next__)
    timer.allow(0.0, 0)
    assert next(timer.batches([1, 2]))[0] == 1
