"""What `dlokit doctor` says of the cameras that are devices."""

import re
from dataclasses import replace

import pytest

from dlokit.app.doctor.machine import Severity, connected_serials, device_findings
from dlokit.communication.memory import MemoryTransport
from dlokit.errors import HardwareError
from dlokit.extras.cameras import genicam, realsense
from dlokit.extras.cameras.findings import camera_finding
from dlokit.extras.cameras.genicam import FoundGenicam, GenicamConfig
from dlokit.extras.cameras.realsense import FoundCamera, RealSenseConfig, doctor_row
from dlokit.functional.cameras.strategies import CAMERAS

D435 = FoundCamera(name="Intel RealSense D435", serial="0042", usb="3.2")


@pytest.mark.parametrize(
    ("found", "severity", "says", "fix"),
    [
        (None, Severity.OPTIONAL, "only needed for RealSense", r"\[realsense\]"),
        ((), Severity.READY, "no camera is connected", "^$"),
        ((D435,), Severity.READY, r"D435 0042 on USB 3\.2", "^$"),
        ((replace(D435, usb="2.1"),), Severity.ADVICE, "too slow", "port of USB 3"),
    ],
)
def test_a_realsense_camera_is_found_with_its_port(
    found: tuple[FoundCamera, ...] | None, severity: Severity, says: str, fix: str
) -> None:
    row = doctor_row(lambda: found)
    assert row.standing is severity
    assert re.search(says, row.found)
    assert re.search(fix, row.fix)


def test_cameras_are_listed_with_the_names_to_choose_them_by() -> None:
    one = FoundGenicam(id="Maker-7", address="192.168.0.7", serial="7", model="GX7")
    assert camera_finding("GenICam", "aravis", lambda: [one], "apt").found == "GX7 7 at 192.168.0.7"
    bare = replace(one, serial="")
    assert camera_finding("GenICam", "aravis", lambda: [bare], "apt").found == (
        "GX7 Maker-7 (without a serial number) at 192.168.0.7"
    )
    assert str(replace(D435, serial="")) == "Intel RealSense D435 without a serial number on USB 3.2"
    assert "no camera answers" in camera_finding("SceneScan", "visiontransfer", lambda: [], "apt").found
    missing = camera_finding("SceneScan", "visiontransfer", lambda: None, "see nerian.com")
    assert missing.standing is Severity.OPTIONAL
    assert missing.fix == "see nerian.com"


def test_each_of_our_devices_has_a_row() -> None:
    rows = {row.what: row for row in device_findings()}
    assert set(rows) == {
        "franky-control",
        "franka-rs",
        "RealSense cameras",
        "GenICam cameras",
        "SceneScan cameras",
        "ROS 2",
    }
    assert all(row.fix for row in rows.values() if row.standing is Severity.OPTIONAL)


@pytest.mark.parametrize("name", CAMERAS.installed())
def test_serials_are_asked_of_the_cameras_that_know_them(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RealSenseConfig, "connected_serials", lambda: ["42"])
    monkeypatch.setattr(GenicamConfig, "connected_serials", lambda: ["7"])
    assert connected_serials(name) == {"realsense": ["42"], "genicam": ["7"]}.get(name)


def test_a_pair_may_be_named_by_addresses_of_cameras_without_a_serial(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = FoundGenicam(id="Maker-7", address="192.168.0.7", serial="", model="GX7")
    monkeypatch.setattr(genicam, "connected_cameras", lambda: [bare])
    assert connected_serials("genicam") == ["192.168.0.7", "Maker-7"]


@pytest.mark.parametrize(
    ("serials", "remedy"), [(("42", "43"), "name one with --camera.serial"), (("", ""), "connect only the one to use")]
)
def test_one_of_several_realsense_cameras_is_not_taken_by_chance(
    serials: tuple[str, ...], remedy: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyrealsense2")
    monkeypatch.setattr(realsense, "connected_cameras", lambda: [replace(D435, serial=each) for each in serials])
    with pytest.raises(HardwareError, match=f"2 RealSense cameras are connected .*: {remedy}"):
        RealSenseConfig().build(MemoryTransport()).__enter__()


def test_a_driver_that_cannot_load_names_the_library() -> None:
    def search() -> None:
        raise HardwareError("libusb-1.0.so.0: cannot open shared object file")

    row = doctor_row(search)
    assert row.standing is Severity.ADVICE
    assert "apt install libusb-1.0-0" in row.fix
