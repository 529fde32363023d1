"""Peers that zenoh refuses are named in the log, and a peer that tries again and again does not fill it."""

import logging

import pytest

from dlokit.communication.log_rate import PERIOD_S
from dlokit.communication.zenoh.access import RefusalLog

REFUSED = (
    b"DEBUG acc-0 zenoh_transport::unicast::establishment::accept: UsrPwd extension - Recv OpenSyn. Invalid password."
)
ACCEPTED = b"DEBUG acc-0 zenoh_transport::unicast::establishment::accept: New transport link accepted from 9249 to c5f5"


def test_refusals_are_logged_at_once_and_then_counted(caplog: pytest.LogCaptureFixture) -> None:
    now_s = 5.0
    refusals = RefusalLog(lambda: now_s)
    with caplog.at_level(logging.WARNING):
        assert refusals.take(ACCEPTED)
        assert caplog.messages == []
        for _ in range(1000):
            assert refusals.take(REFUSED)
        assert len(caplog.messages) == 1
        now_s += PERIOD_S
        refusals.take(REFUSED)
    assert [message.rpartition(" ")[2] for message in caplog.messages] == ["1", "1000"]


def test_output_of_other_libraries_is_not_taken() -> None:
    assert not RefusalLog().take(b"WARNING: Nan, Inf or huge value in QACC at DOF 0.\n")
