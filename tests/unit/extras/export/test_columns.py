"""Messages of one topic as columns: whole numbers stay whole, and a number that a message lacks is NaN."""

import numpy as np

from dlokit.extras.export.columns import columns
from dlokit.recording.reader import Recorded
from dlokit.types.dlo import TargetPoints
from dlokit.types.flow import FlowStatus

STAMP_NS = 1_764_336_000_000_000_001
"""A time of the machine's clock: a float would round it by up to 128 ns."""


def test_whole_numbers_stay_whole_and_a_missing_number_is_nan() -> None:
    statuses = [
        FlowStatus(stamp_ns=STAMP_NS, flow="shape", step="look", actions=1),
        FlowStatus(stamp_ns=STAMP_NS + 1, flow="shape", step="decide", actions=2, rmse_m=0.25),
    ]
    found = columns([Recorded(topic="decision/flow", log_ns=n, message=status) for n, status in enumerate(statuses)])
    values = {column.name: column.values for column in found}
    assert values["stamp_ns"].tolist() == [STAMP_NS, STAMP_NS + 1]
    assert values["actions"].dtype.kind == values["stamp_ns"].dtype.kind == "i"
    assert np.isnan(values["rmse_m"][0])
    assert values["rmse_m"][1] == 0.25
    assert values["step"].tolist() == ["look", "decide"]
    assert "outcome" not in values, "a field that no message has is no column"


def test_the_arrays_of_a_memory_are_columns_of_their_own() -> None:
    nodes, visible = np.zeros((3, 3)), np.ones(3, dtype=np.bool_)
    kept = [{}, {"weights": np.array([0.25, 0.75])}]
    messages = [TargetPoints(stamp_ns=n, nodes_world=nodes, visible=visible, memory=one) for n, one in enumerate(kept)]
    found = columns([Recorded(topic="observer/targets", log_ns=n, message=one) for n, one in enumerate(messages)])
    values = {column.name: column.values for column in found}
    np.testing.assert_array_equal(values["memory.weights"], [[np.nan, np.nan], [0.25, 0.75]])
