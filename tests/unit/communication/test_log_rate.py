"""A peer that floods the bus does not fill a log."""

from dlokit.communication.log_rate import PERIOD_S, LogRate


def test_the_first_is_logged_at_once_and_later_ones_once_in_a_period_with_their_number() -> None:
    now_s = 3.0
    rate = LogRate(lambda: now_s)
    assert [rate.due("a") for _ in range(1000)] == [1] + [0] * 999
    now_s += PERIOD_S - 0.01
    assert rate.due("a") == 0
    now_s += 0.01
    assert rate.due("a") == 1001
    assert rate.due("a") == 0


def test_each_kind_has_a_rate_of_its_own() -> None:
    rate = LogRate(lambda: 0.0)
    assert [rate.due("a"), rate.due("b"), rate.due("a")] == [1, 1, 0]
