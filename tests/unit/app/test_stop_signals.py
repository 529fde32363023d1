"""A run that a signal ends reports which signal; the end of a terminal is one request to end, however it is sent."""

import os
import signal
import threading
from collections.abc import Generator

import pytest

from dlokit.app.environment import handle_signals
from dlokit.system.signals import interrupts_answered, signals_noted, terminal_signals_blocked


@pytest.fixture
def as_the_command_line_does() -> Generator[None]:
    """SIGTERM and SIGHUP are passed on as SIGINT."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    handle_signals()
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("as_the_command_line_does")
@pytest.mark.parametrize(
    ("number", "name"),
    [
        (signal.SIGINT, "SIGINT (Ctrl-C)"),
        (signal.SIGTERM, "SIGTERM"),
        (signal.SIGHUP, "SIGHUP (terminal closed)"),
    ],
)
def test_the_first_signal_is_named_and_passed_on(number: signal.Signals, name: str) -> None:
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with signals_noted() as stopped_by:
        assert stopped_by() == ""
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), number)
        assert stopped_by() == name
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers


@pytest.mark.usefixtures("as_the_command_line_does")
@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_while_a_run_winds_up_no_signal_interrupts_it_again(first: signal.Signals) -> None:
    told: list[str] = []
    with signals_noted(told.append, lambda: told.append("again")) as stopped_by:
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), first)
        os.kill(os.getpid(), signal.SIGINT)
        assert told == [stopped_by(), "again"]
        for again in (signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), again)
        assert told[0] == stopped_by()
        assert set(told[1:]) == {"again"}
    with pytest.raises(KeyboardInterrupt):  # what comes after the run
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("as_the_command_line_does")
def test_the_last_files_of_a_run_are_written_whatever_signal_comes_meanwhile() -> None:
    answered: list[int] = []
    with interrupts_answered(lambda: answered.append(1)):
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(os.getpid(), number)
    assert len(answered) >= 2
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.usefixtures("as_the_command_line_does")
def test_the_end_of_a_login_is_one_request_and_a_second_sigterm_is_another() -> None:
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGHUP)
    os.kill(os.getpid(), signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGTERM)


def test_a_command_under_nohup_goes_on_when_the_terminal_is_closed() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
        handle_signals()
        os.kill(os.getpid(), signal.SIGHUP)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_the_lines_of_a_command_whose_terminal_has_gone_are_dropped() -> None:
    read, write = os.openpty()
    kept = os.dup(1)
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    try:
        os.dup2(write, 1)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
        handle_signals()
        os.close(read)
        with pytest.raises(OSError, match="Input/output error"):
            os.write(1, b"a line")
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGHUP)
        os.write(1, b"a line")
    finally:
        os.dup2(kept, 1)
        for each in (write, kept):
            os.close(each)
        for number, handler in before.items():
            signal.signal(number, handler)


def test_a_signal_that_ends_the_process_at_once_keeps_doing_so() -> None:
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)
    try:
        with signals_noted():
            assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before)


def test_processes_start_without_the_signals_of_a_terminal() -> None:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with terminal_signals_blocked():
        assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= {signal.SIGINT, signal.SIGHUP}
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_another_thread_than_the_main_one_handles_no_signals() -> None:
    said: list[str] = []

    def run() -> None:
        with signals_noted() as stopped_by:
            said.append(stopped_by())

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(10.0)
    assert said == [""]
