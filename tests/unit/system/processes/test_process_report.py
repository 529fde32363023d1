"""Which processes of a run have not ended."""

import subprocess
import sys
from pathlib import Path

import pytest

from dlokit.system.processes.report import ProcessReport, ProcessState, SystemReport, unended_processes, write_report


def process(name: str, pid: int) -> ProcessReport:
    return ProcessReport(
        name=name, components=(name,), pid=pid, state=ProcessState.RUNNING, started_s=0.0, restarts=0, beat_s=0.0
    )


@pytest.mark.live
def test_a_process_counts_as_running_until_its_end_even_if_its_id_is_reused(tmp_path: Path) -> None:
    assert unended_processes(tmp_path) == []
    waits = (sys.executable, "-c", "import sys; print('up', flush=True); sys.stdin.read()", "cell")
    with subprocess.Popen(waits, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as cell:
        assert cell.stdout is not None
        cell.stdout.readline()  # only now is its command line sure to be its own
        write_report(
            tmp_path, SystemReport(written_s=0.0, processes=(process("cell", cell.pid), process("robot", cell.pid)))
        )
        assert unended_processes(tmp_path) == ["cell"]
    assert unended_processes(tmp_path) == []
