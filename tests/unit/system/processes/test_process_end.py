"""A process of dlokit ends without taking its memory apart, and loses nothing that a program expects of its end."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.live

HANGS_S = 60.0
SCRIPT = """
import atexit, sys, threading, time
from dlokit.system.processes.process_end import without_teardown

class Large:
    def __del__(self):
        print("taken apart", flush=True)

def work():
    time.sleep(0.1)
    print("the thread has ended")

kept = Large()
with without_teardown():
    atexit.register(print, "the handler was called")
    threading.Thread(target=work).start()
    {last}
"""
KEPT = "the thread has ended\nthe handler was called\n"


def ended(last: str) -> "subprocess.CompletedProcess[str]":
    command = (sys.executable, "-c", SCRIPT.format(last=last))
    return subprocess.run(command, capture_output=True, text=True, timeout=HANGS_S, check=False)


@pytest.mark.parametrize(
    ("last", "code"), [("pass", 0), ("sys.exit(3)", 3), ("sys.exit(0)", 0), ("sys.exit()", 0), ("sys.exit(False)", 0)]
)
def test_threads_handlers_output_and_exit_code_are_those_of_any_program(last: str, code: int) -> None:
    done = ended(last)
    assert (done.returncode, done.stdout, done.stderr) == (code, KEPT, "")


def test_an_error_is_shown_and_its_program_ends_as_always() -> None:
    done = ended("raise OSError('broken')")
    assert done.returncode == 1
    assert "OSError: broken" in done.stderr
    assert KEPT in done.stdout


def test_an_exit_with_a_sentence_prints_it_and_is_an_error() -> None:
    done = ended("sys.exit('a sentence')")
    assert (done.returncode, done.stderr) == (1, "a sentence\n")
