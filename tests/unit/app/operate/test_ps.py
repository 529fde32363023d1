"""`dlokit ps`: states and resource use of processes."""

import io
import os
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from dlokit.app.operate.ps import Use, files_text, measure, process_table
from dlokit.system.processes.report import ProcessReport, ProcessState, SystemReport, read_report, write_report
from dlokit.system.processes.running import RunningSystem

SYSTEM = RunningSystem(pid=41, began_s=0.0, folder="runs/a", namespace="dlokit/a", endpoint="tcp/127.0.0.1:1")
CAMERA = ProcessReport(
    name="camera",
    components=("perception",),
    pid=42,
    state=ProcessState.WAITING,
    started_s=100.0,
    restarts=2,
    beat_s=107.5,
)


def text_of(report: SystemReport | None, used: dict[int, Use], now_s: float) -> str:
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(process_table(SYSTEM, report, used, now_s))
    return console.export_text()


def test_every_process_is_listed_with_state_restarts_and_resource_use() -> None:
    report = SystemReport(written_s=110.0, processes=(CAMERA,))
    text = text_of(report, {42: Use(cores=0.25, memory_bytes=300_000_000)}, now_s=110.0)
    camera = next(line for line in text.splitlines() if "camera" in line)
    for cell in ("perception", "42", "waiting to start again", " 10 ", " 2 ", " 2.5 ", "0.25", "300"):
        assert cell in camera
    assert any("decision" in line and "41" in line for line in text.splitlines())
    assert "written no report" not in text


def test_a_healthy_system_fits_into_80_columns() -> None:
    rows = (("simulation", "model"), ("camera", "perception"), ("observer", "observer"))
    running = msgspec.structs.replace(CAMERA, pid=4_194_304, state=ProcessState.RUNNING, started_s=0.0, beat_s=3599.0)
    processes = tuple(msgspec.structs.replace(running, name=name, components=(component,)) for name, component in rows)
    used = {41: Use(cores=0.25, memory_bytes=300_000_000), 4_194_304: Use(cores=1.25, memory_bytes=1_300_000_000)}
    system = msgspec.structs.replace(SYSTEM, began_s=time.time() - 3600.0)
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(process_table(system, SystemReport(written_s=3600.0, processes=processes), used, 3600.0))
    text = console.export_text()
    for whole in (*(cell for row in rows for cell in row), "components", "4194304", "running", "restarts", "1300"):
        assert whole in text


def test_a_silent_supervisor_is_reported() -> None:
    assert "written no report for 30 s" in text_of(SystemReport(written_s=110.0, processes=()), {}, now_s=140.0)
    assert "decision" in text_of(None, {}, now_s=140.0)


def test_a_system_that_is_ending_says_so_with_the_processes_that_have_ended_and_is_not_silent() -> None:
    running = msgspec.structs.replace(CAMERA, state=ProcessState.RUNNING)
    gone = msgspec.structs.replace(running, name="observer", pid=43)
    system = msgspec.structs.replace(SYSTEM, ending=True)
    used = {41: Use(cores=0.1, memory_bytes=1), 42: Use(cores=0.1, memory_bytes=1)}
    console = Console(width=120, record=True, file=io.StringIO())
    console.print(process_table(system, SystemReport(written_s=110.0, processes=(running, gone)), used, 140.0))
    lines = console.export_text().splitlines()
    states = {name: next(line for line in lines if name in line) for name in ("decision", "camera", "observer")}
    assert "ending" in states["decision"]
    assert "ending" in states["camera"]
    assert "ended" in states["observer"]
    assert not any("running" in line or "written no report" in line for line in lines)


def test_the_report_is_read_as_written(tmp_path: Path) -> None:
    report = SystemReport(written_s=110.0, processes=(CAMERA,))
    assert read_report(tmp_path) is None
    write_report(tmp_path, report)
    assert read_report(tmp_path) == report


@pytest.mark.live
def test_resource_use_is_measured_and_an_ended_process_is_omitted() -> None:
    with subprocess.Popen((sys.executable, "-c", "")) as ended:
        ended.wait()
    used = measure((os.getpid(), ended.pid), 0.01)
    assert used[os.getpid()].memory_bytes > 1_000_000
    assert ended.pid not in used


def test_the_sizes_of_recording_and_logs_are_shown_with_their_limits(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "recording.mcap").write_bytes(bytes(2_000_000))
    (tmp_path / "recording.001.mcap").write_bytes(bytes(1_000_000))
    for name in ("robot.log", "robot.log.1"):
        (tmp_path / "logs" / name).write_bytes(bytes(150_000))
    text = files_text(tmp_path)
    assert text == "recording 3 MB in 2 files (at most 16 GB), logs 0.3 MB (at most 20 each)"
    assert "recording 0 MB" in files_text(tmp_path / "gone")


def test_descriptors_and_threads_are_counted() -> None:
    used = measure((os.getpid(),), 0.01)[os.getpid()]
    assert used.descriptors >= 3
    assert used.threads >= 1
