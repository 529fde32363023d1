import os
import re
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from rich.console import Console

from dlokit.app.doctor import doctor, machine
from dlokit.app.doctor.doctor import DoctorArgs
from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.app.doctor.opengl import OpenGLReport, check_picture, probe_opengl
from dlokit.errors import InputError, pip_command


def _nowhere(name: str) -> None:
    return None


@pytest.mark.live
def test_a_picture_is_really_rendered() -> None:
    report = probe_opengl()

    assert report.works, report.text
    assert report.text


@pytest.mark.live
def test_a_broken_opengl_is_reported_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    # Where the loader looks for drivers; with none, EGL cannot start.
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_FILENAMES", "/nonexistent")

    report = probe_opengl()
    finding = machine.opengl_finding(report)

    assert not report.works
    assert "Error" in report.text
    assert "\n" not in report.text
    assert finding.standing is Severity.LACKING
    assert "apt install" in finding.fix


@pytest.mark.live
def test_a_rendering_that_takes_too_long_is_a_finding_and_does_not_block() -> None:
    report = probe_opengl(timeout_s=0.001)

    assert not report.works
    assert "did not finish" in report.text


def test_an_opengl_that_draws_nothing_does_not_work() -> None:
    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    with pytest.raises(RuntimeError, match="draws nothing"):
        check_picture(picture)
    picture[1, 1] = 255
    check_picture(picture)


@pytest.mark.parametrize(
    ("finding", "standing"),
    [
        (machine.python_finding((3, 11, 2)), Severity.READY),
        (machine.python_finding((3, 10, 9)), Severity.LACKING),
        (machine.opengl_finding(OpenGLReport(works=True, text="llvmpipe")), Severity.READY),
        (machine.cores_finding(2), Severity.READY),
        (machine.cores_finding(1), Severity.ADVICE),
        (machine.urgency_finding(True), Severity.READY),
        (machine.urgency_finding(False), Severity.ADVICE),
        (machine.memory_finding(8.0), Severity.READY),
        (machine.memory_finding(0.5), Severity.ADVICE),
        (machine.package_finding(Requirement("numpy>=2.2"), {"numpy": "2.2.1"}.get), Severity.READY),
        (machine.package_finding(Requirement("numpy>=2.2"), {"numpy": "2.1.9"}.get), Severity.LACKING),
        (machine.package_finding(Requirement("numpy>=2.2"), _nowhere), Severity.LACKING),
        (machine.device_package_finding("numpy", "numpy", "an arm", "pip install numpy"), Severity.READY),
        (machine.device_package_finding("mumpy", "mumpy", "an arm", "pip install mumpy"), Severity.OPTIONAL),
        (machine.browser_finding(lambda name: f"/usr/bin/{name}"), Severity.READY),
        (machine.browser_finding(_nowhere), Severity.OPTIONAL),
    ],
)
def test_each_finding_has_its_status_and_the_command_that_fixes_it(finding: DoctorRow, standing: Severity) -> None:
    assert finding.standing is standing
    assert bool(finding.fix) is (standing is not Severity.READY)


def test_a_wrong_version_names_the_one_that_is_needed() -> None:
    finding = machine.package_finding(Requirement("mujoco>=4.0"), {"mujoco": "3.3.0"}.get)

    assert finding.found == "3.3.0; >=4.0 is needed"
    assert finding.fix == pip_command("mujoco>=4.0")


def test_every_dependency_is_checked_but_no_extra() -> None:
    names = {finding.what for finding in machine.dependency_findings()}

    assert {"dlokit", "mujoco", "eclipse-zenoh", "numpy"} <= names
    assert not {"pytest", "pycpd"} & names


def test_a_package_that_is_not_installed_is_lacking() -> None:
    (finding,) = machine.dependency_findings("dlokit-that-is-not-there")

    assert finding.standing is Severity.LACKING


@pytest.mark.live
def test_a_port_in_use_is_reported_with_a_remedy() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]

        finding = machine.port_finding("127.0.0.1", port)

    assert finding.standing is Severity.ADVICE
    assert str(port) in finding.what
    assert "--port" in finding.fix
    assert machine.port_finding("127.0.0.1", port).standing is Severity.READY


def test_the_kernels_of_observers_and_planners_are_compiled_and_timed() -> None:
    finding = machine.kernels_finding()

    assert finding.standing is Severity.READY
    assert re.search(r"kept in /\S+, loaded in \d+\.\d s", finding.found)


def test_a_machine_without_a_folder_for_compiled_code_lacks_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)

    finding = machine.kernels_finding()

    assert finding.standing is Severity.LACKING
    assert "can be written" in finding.found
    assert "NUMBA_CACHE_DIR" in finding.fix


LACKING = DoctorRow(what="OpenGL (EGL)", standing=Severity.LACKING, found="no EGL", fix="sudo apt install libegl1")
OPTIONAL = DoctorRow(what="aravis", standing=Severity.OPTIONAL, found="only for cameras", fix="sudo apt install aravis")
READY = DoctorRow(what="Python", standing=Severity.READY, found="3.11.2")


def _examines(*findings: DoctorRow) -> Callable[[DoctorArgs], tuple[DoctorRow, ...]]:
    return lambda _: findings


def test_the_exit_code_shows_whether_a_requirement_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "examine", _examines(READY, LACKING, OPTIONAL))
    assert doctor.run(DoctorArgs()) == 2
    assert "cannot run here yet: OpenGL (EGL)" in capsys.readouterr().out

    monkeypatch.setattr(doctor, "examine", _examines(READY, OPTIONAL))
    assert doctor.run(DoctorArgs()) == 0
    assert "can run here" in capsys.readouterr().out


def test_an_installation_is_examined_without_the_machine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "lab.toml"
    file.write_text("[[arms]]\n")
    assert doctor.run(DoctorArgs(installation=file)) == 0
    said = capsys.readouterr().out
    assert "first arm" in said
    assert "The installation can work." in said
    assert "Python" not in said

    file.write_text("[[arms]]\nposition_m = [0.0, 300.0, 0.0]\n")
    assert doctor.run(DoctorArgs(installation=file)) == 2
    assert "The installation cannot work yet: first arm." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("file", "picture", "named"), [(None, "lab.png", "add --installation"), ("lab.toml", "lab.bmp", ".png or .jpg")]
)
def test_a_picture_is_of_an_installation_and_of_a_known_format(file: str | None, picture: str, named: str) -> None:
    with pytest.raises(InputError, match=re.escape(named)):
        doctor.run(DoctorArgs(installation=None if file is None else Path(file), picture=Path(picture)))


def test_the_table_shows_the_command_that_fixes_a_finding() -> None:
    console = Console(width=140, record=True, quiet=False, file=None)
    with console.capture() as captured:
        console.print(doctor.findings_table([READY, LACKING], "dlokit doctor"))

    assert "sudo apt install libegl1" in captured.get()
    assert "lacking" in captured.get()
