"""A recording whose process is killed is readable and lacks at most the last second."""

import subprocess
import sys
from pathlib import Path

from dlokit.recording.reader import read_recording
from dlokit.recording.summary import summarise

LOST_S = 1.0  # chunks end every half second; the other half is for a loaded machine


def test_a_killed_process_loses_at_most_the_last_second_of_its_recording(tmp_path: Path) -> None:
    path = tmp_path / "recording.mcap"
    program = str(Path(__file__).with_name("killed_recorder.py"))
    with subprocess.Popen([sys.executable, program, str(path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        last_ns = 0
        while last_ns < 2e9:
            last_ns = int(process.stdout.readline())
        process.kill()
        last_ns = max([last_ns, *(int(line) for line in process.stdout)])
    assert (last_ns - max(one.message.stamp_ns for one in read_recording(path))) / 1e9 < LOST_S
    assert not summarise(path).whole
