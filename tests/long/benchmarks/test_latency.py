import pytest

from latency import CLOUD, DECISION, EXPOSURE, PICTURES, STATE, TARGETS, Sent, hops, machine_time_s

TICKS = [(0, 100.0), (10_000_000, 100.02), (20_000_000, 100.04)]  # a cell at half the machine's pace


def test_the_cells_stamps_are_converted_to_machine_time() -> None:
    assert machine_time_s(10_000_000, TICKS) == 100.02
    assert machine_time_s(15_000_000, TICKS) == pytest.approx(100.03)


@pytest.mark.parametrize("stamp_ns", [-1, 20_000_001])
def test_a_stamp_outside_the_received_ones_has_no_time(stamp_ns: int) -> None:
    assert machine_time_s(stamp_ns, TICKS) is None
    assert machine_time_s(stamp_ns, []) is None


def one_look() -> Sent:
    sent = Sent(ticks=list(TICKS))
    for station, sent_s in ((PICTURES, 100.1), (CLOUD, 100.3), (TARGETS, 100.32), (STATE, 100.4)):
        sent.note(station, 10_000_000, sent_s)
    return sent


def test_each_hop_counts_from_the_previous_stage_and_the_total_from_the_exposure() -> None:
    sent = one_look()
    sent.decisions_s = [100.05, 100.45, 100.6]
    found = hops(sent)
    assert [seconds[0] for seconds in found.values()] == pytest.approx([0.08, 0.2, 0.02, 0.08, 0.05, 0.43])
    assert list(found)[-1] == (EXPOSURE, DECISION)


def test_only_the_first_message_of_an_exposure_counts() -> None:
    sent = one_look()
    sent.note(STATE, 10_000_000, 107.0)
    assert hops(sent)[TARGETS, STATE] == pytest.approx([0.08])


def test_an_observation_followed_by_another_before_a_step_has_no_decision() -> None:
    sent = one_look()
    sent.note(STATE, 20_000_000, 100.5)
    sent.decisions_s = [100.7]
    found = hops(sent)
    assert found[STATE, DECISION] == pytest.approx([0.2])
    assert found[EXPOSURE, DECISION] == pytest.approx([100.7 - 100.04])


def test_an_observation_without_a_cloud_counts_up_to_its_last_stage() -> None:
    sent = Sent(ticks=list(TICKS))
    sent.note(PICTURES, 0, 100.01)
    found = hops(sent)
    assert found[EXPOSURE, PICTURES] == pytest.approx([0.01])
    assert found[PICTURES, CLOUD] == []
