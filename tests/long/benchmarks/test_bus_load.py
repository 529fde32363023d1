import time

import pytest

from dlokit.communication.wire import codec
from parts.bus_load import SIZES_BYTES, body_of, load_now, since_load, since_stamp, stamped


@pytest.mark.parametrize("size", SIZES_BYTES)
def test_a_message_has_the_nominal_size(size: int) -> None:
    assert len(codec.encode(load_now(body_of(size)))) == pytest.approx(size, abs=16)  # whole values, and their count


def test_delays_count_from_the_send_call() -> None:
    before_s = time.monotonic()
    ours, bare = load_now(body_of(200)), bytes(stamped(bytearray(200)))
    elapsed_s = time.monotonic() - before_s
    for seconds in (since_load(ours), since_stamp(bare)):
        assert seconds >= 0.0
        assert seconds - elapsed_s < time.monotonic() - before_s
