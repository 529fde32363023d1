"""A run that a signal ends reports which signal."""

import os
import signal
import threading
from collections.abc import Generator

import pytest

from dlokit.system.shaping import signals_noted


@pytest.fixture
def as_the_command_line_does() -> Generator[None]:
    """SIGTERM is passed on as SIGINT."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("as_the_command_line_does")
@pytest.mark.parametrize(("number", "name"), [(signal.SIGINT, "SIGINT (Ctrl-C)"), (signal.SIGTERM, "SIGTERM")])
def test_the_first_signal_is_named_and_passed_on(number: signal.Signals, name: str) -> None:
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with signals_noted() as stopped_by:
        assert stopped_by() == ""
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
        assert stopped_by() == name
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


def test_a_signal_that_ends_the_process_at_once_keeps_doing_so() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with signals_noted():
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)


def test_another_thread_than_the_main_one_handles_no_signals() -> None:
    said: list[str] = []

    def run() -> None:
        with signals_noted() as stopped_by:
            said.append(stopped_by())

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10.0)
    assert said == [""]
