"""Time at which a flow continued after a fault."""

import math

from parts.faults.trial import recovery_time_s


def test_a_flow_without_recovery_continued_at_once() -> None:
    assert recovery_time_s([(1.0, "restore"), (2.0, "compare"), (5.0, "approach")], 3.0) == 0.0


def test_a_flow_continues_when_it_leaves_its_last_recovery_step() -> None:
    boxes = [(1.0, "find_dlo"), (4.0, "restore"), (6.0, "track_again"), (7.0, "restore"), (9.0, "track_again")]
    assert recovery_time_s(boxes, 3.0) == 6.0


def test_a_flow_that_ended_in_recovery_never_continued() -> None:
    assert recovery_time_s([(4.0, "recover")], 3.0) == math.inf
