"""A recording whose process is killed is readable, and has what the process had written meanwhile."""

import subprocess
import sys
from pathlib import Path

from dlokit.errors import InputError
from dlokit.recording.reader import read_recording
from dlokit.recording.summary import summarise

RECORDED_NS = 1_000_000_000
"""The process writes twice a second: this much has arrived in the file after some seconds of a slow machine."""


def newest_ns(path: Path) -> int:
    """The time of the newest message that can be read; 0 if none can."""
    try:
        return max((one.message.stamp_ns for one in read_recording(path)), default=0)
    except InputError:
        return 0


def test_a_killed_process_keeps_what_it_has_recorded_and_its_recording_is_not_whole(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    program = str(Path(__file__).with_name("killed_recorder.py"))
    with subprocess.Popen([sys.executable, program, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        seen_ns = 0
        for _ in process.stdout:  # once a tick
            if (seen_ns := newest_ns(path)) > RECORDED_NS:
                break
        process.kill()
        process.stdout.read()
    assert seen_ns > RECORDED_NS
    assert newest_ns(path) >= seen_ns
    assert summarise(path).missing
