"""The bench of the bus between two real processes, as small as can be."""

import pytest

from dlokit.app.bench.bus import by_method
from dlokit.bench.bus.comparison import compare
from dlokit.bench.bus.slow_reader import WAYS, measure_slow_readers

pytestmark = pytest.mark.system

REPEATS = 3


def test_every_method_carries_every_message_and_answers_every_call() -> None:
    times = compare(REPEATS, sizes=(200, 24_000))
    for size in (200, 24_000):
        one_way, calls = by_method(times.one_way, size), by_method(times.calls, size)
        assert {"dlokit", "zenoh", "zenoh, asyncio"} <= set(one_way)
        assert {"dlokit", "zenoh, asyncio"} <= set(calls)
        for way in (one_way, calls):
            assert {method: len(seconds) for method, seconds in way.items()} == dict.fromkeys(way, REPEATS)
            assert all(0.0 < value < 20.0 for seconds in way.values() for value in seconds)


def test_every_kind_of_slow_reader_reads_and_says_how_old() -> None:
    for times in measure_slow_readers(0.3):
        assert times.way in WAYS
        assert len(times.puts_s) == 30
        assert times.ages_s
        assert all(age_s > 0.0 for age_s in times.ages_s)
