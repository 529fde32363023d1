"""The report of a check of a device, with its requirements and results, as a folder to attach to a bug report.

It is written whether or not the device passed: people report failures.
"""

import importlib.metadata
import platform
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import numpy as np

from dlokit.extras.checks.checks import Unmet
from dlokit.functional.cameras.calibration_file import write_calibration
from dlokit.recording.views import to_png
from dlokit.system.results.run_folder import new_run_folder
from dlokit.system.results.run_result import machine_facts
from dlokit.types.image import CameraPictures, StereoImages

RUNS = Path("runs")
REPORT_FILE = "report.md"
DEVICE_PACKAGES = ("franky-control", "franka-rs", "pyrealsense2", "PyGObject", "airo-models", "rtb-data")
"""Packages of drivers and arm models; the report also names absent ones."""


@dataclass(frozen=True, kw_only=True)
class CheckedDevice:
    """The results of the checks of a device."""

    what: str
    """The device, with the class of its driver or the name of its model."""
    wanted: Mapping[str, str]
    """The requirement of each check, in the order of the checks."""
    found: Sequence[Unmet] = ()
    """Unmet requirements; empty: the device passed."""
    untried: Sequence[str] = ()
    """Checks that an earlier failure made impossible."""
    facts: Mapping[str, str] = field(default_factory=dict[str, str])
    """The device's description."""
    timing: Mapping[str, str] = field(default_factory=dict[str, str])
    """Durations and numbers of calls."""
    pictures: CameraPictures | None = None
    """The last pictures of a camera."""


def write_report(checked: CheckedDevice, kind: str, root: Path = RUNS) -> Path:
    """Write ``runs/<time>-check-<kind>/report.md``, and the last pictures beside it; returns the path of the report.

    To replay the pictures: ``dlokit track --camera recorded --camera.path FOLDER``.
    """
    folder = new_run_folder(root, f"check-{kind}", datetime.now())
    path = folder / REPORT_FILE
    path.write_text(_text(checked, kind), encoding="utf-8")
    if checked.pictures is not None:
        _write_pictures(folder, checked.pictures)
    return path


def spread(seconds: Sequence[float]) -> str:
    """Median, 95th percentile and maximum of times, in milliseconds."""
    p50, p95, most = (1e3 * float(np.quantile(seconds, part)) for part in (0.5, 0.95, 1.0))
    return f"p50 {p50:.1f} ms, p95 {p95:.1f} ms, longest {most:.1f} ms of {len(seconds)}"


def _text(checked: CheckedDevice, kind: str) -> str:
    failed = {finding.check for finding in checked.found}
    verdict = (
        f"FAILED: {', '.join(failed)}" if failed else f"passed {len(checked.wanted) - len(checked.untried)} checks"
    )
    if checked.untried and not failed:
        verdict += f", {len(checked.untried)} not tried"
    lines = [
        f"# Check of a {kind}: {verdict}",
        "",
        checked.what,
        "",
        f"    {shlex.join(['python', '-m', 'dlokit.testing', *sys.argv[1:]])}",
        "",
        f"{datetime.now().astimezone():%Y-%m-%d %H:%M:%S %z}",
        "",
        *_table("device", checked.facts),
        *_table("timing", checked.timing),
        "| check | result | wanted |",
        "|---|---|---|",
    ]
    for name, wanted in checked.wanted.items():
        wrong = [finding.wrong for finding in checked.found if finding.check == name]
        result = "; ".join(("**failed**", *wrong)) if wrong else "not tried" if name in checked.untried else "passed"
        lines.append(f"| {name} | {_cell(result)} | {_cell(wanted)} |")
    return "\n".join([*lines, "", *_table("machine", {"platform": _platform()} | machine_facts() | _device_packages())])


def _platform() -> str:
    """Kernel and C library; `platform.platform` would start a process."""
    return "-".join((platform.system(), platform.release(), platform.machine(), *filter(None, platform.libc_ver())))


def _device_packages() -> dict[str, str]:
    versions: dict[str, str] = {}
    for package in DEVICE_PACKAGES:
        try:
            versions[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _table(heading: str, rows: Mapping[str, str]) -> list[str]:
    if not rows:
        return []
    return [f"| {heading} | |", "|---|---|", *(f"| {name} | {_cell(value)} |" for name, value in rows.items()), ""]


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _write_pictures(folder: Path, pictures: CameraPictures) -> None:
    import cv2

    stereo = isinstance(pictures, StereoImages)
    colour = {"left": pictures.left, "right": pictures.right} if stereo else {"colour": pictures.pixels}
    for name, pixels in colour.items():
        cv2.imwrite(str(folder / f"{name}_0.png"), cv2.cvtColor(pixels, cv2.COLOR_RGB2BGR))
    if not stereo:
        (folder / "depth_0.png").write_bytes(to_png(pictures.depth_m))
    write_calibration(folder / "calibration.toml", pictures.calibration)
