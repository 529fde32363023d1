"""What a user installs: the source distribution, the wheel made of it, and the wheel in an empty environment."""

import re
import subprocess
import sys
import tarfile
import venv
import zipfile
from importlib.metadata import PathDistribution
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from tutorial_scripts import check_tutorial

ROOT = Path(__file__).parents[2]
SOURCES = {
    str(path.relative_to(ROOT / "src"))
    for path in (ROOT / "src").rglob("*")
    if path.is_file() and "__pycache__" not in path.parts
}

HARNESS = ROOT.parent / "shared" / "data" / "harness"
"""Recorded clouds, which lie beside the repository, not in it."""

TRACK = """
import numpy as np
import dlokit

s = np.linspace(0.0, 0.5, 500)
cloud = np.column_stack([0.4 + 0.0 * s, s - 0.25, np.full(500, 0.005)])
nodes = dlokit.Tracker(length_m=0.5, radius_m=0.004).update(cloud, stamp_ns=0)
assert nodes.health > 0.5, nodes.health
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built from the source distribution, not from the working tree."""
    folder = tmp_path_factory.mktemp("dist")
    run(sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder), cwd=ROOT)
    (source,) = folder.glob("dlokit-*.tar.gz")
    with tarfile.open(source) as archive:
        # An argument of `extractall` since Python 3.11.4; Debian 12 has 3.11.2, which ignores the attribute.
        archive.extraction_filter = getattr(tarfile, "data_filter", lambda member, path: member)
        archive.extractall(folder)
    tree = folder / source.name.removesuffix(".tar.gz")
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder), cwd=tree)
    (wheel,) = folder.glob("dlokit-*.whl")
    assert version_of(wheel) == source.name.removeprefix("dlokit-").removesuffix(".tar.gz")
    return wheel


def test_the_wheel_has_all_sources_and_the_licence_and_no_tests(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    packed = {name for name in names if name.startswith("dlokit/")}
    assert packed == SOURCES
    metadata = f"dlokit-{version_of(wheel)}.dist-info"
    assert f"{metadata}/licenses/LICENSE" in names
    assert {name.split("/")[0] for name in names} == {"dlokit", metadata}


HARDWARE = {"pyrealsense2", "pygobject", "aravis-python", "visiontransfer", "airo-models", "rtb-data"}
"""Packages for one device or arm, by their normalised names; drivers of arms will be among them."""


def test_the_plain_install_pulls_no_package_for_hardware_and_every_extra_comes_from_a_registry(wheel: Path) -> None:
    info = zipfile.Path(wheel, f"dlokit-{version_of(wheel)}.dist-info/")
    required = [Requirement(text) for text in PathDistribution(info).requires or ()]  # pyright: ignore[reportArgumentType]
    extras = {extra for each in required for extra in _extras_of(each)}
    plain = {canonicalize_name(each.name) for each in required if not _extras_of(each)}

    assert {"realsense", "genicam", "scenescan", "arms", "cell"} <= extras
    assert not plain & HARDWARE
    assert not plain & {"mujoco", "opencv-python-headless", "eclipse-zenoh"}
    of = {extra: {canonicalize_name(each.name) for each in required if extra in _extras_of(each)} for extra in extras}
    assert of["cell"] & HARDWARE == {"rtb-data"}  # the meshes of the simulated Panda
    assert [each for each in required if each.url] == []  # no addresses beside the registry
    for extra in ("realsense", "genicam", "scenescan", "arms"):
        # A camera or an arm is of no use without perception, viewer and motions.
        assert of["cell"] <= of[extra], extra


def _extras_of(required: Requirement) -> set[str]:
    """The extras under which something is required; empty: always."""
    return set(re.findall(r"extra == ['\"]([a-z]+)['\"]", str(required.marker or "")))


def test_the_wheel_works_in_an_empty_environment(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env", with_pip=True)
    python = str(tmp_path / "env" / "bin" / "python")
    command = str(tmp_path / "env" / "bin" / "dlokit")
    install = (python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check")

    run(*install, str(wheel), cwd=tmp_path)
    plain_mb = size_mb(tmp_path / "env")
    assert run(command, "--version", cwd=tmp_path).split() == ["dlokit", version_of(wheel)]
    assert "decision" in run(command, "skills", cwd=tmp_path)
    run(python, "-c", TRACK, cwd=tmp_path)
    run(command, "track", *clouds(tmp_path), "--out", "tracked", cwd=tmp_path)
    assert (tmp_path / "tracked").is_dir()
    if HARNESS.is_dir():
        seen = [str(HARNESS / name) for name in ("test_cloud.pcd", "test_cloud_occluded.pcd")]
        initial = ("--initial", str(HARNESS / "Xinit.csv"), "--observer", "anchored")
        run(command, "track", *seen, *initial, "--out", "harness", cwd=tmp_path)
    for asked in ((command, "shape", "--goal", "S"), (python, "-c", "import dlokit; dlokit.shape()")):
        lacking = subprocess.run(asked, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert lacking.returncode != 0
        assert "pip install 'dlokit[all]'" in lacking.stderr

    run(*install, f"dlokit[all] @ {wheel.as_uri()}", cwd=tmp_path)
    assert plain_mb < 0.6 * size_mb(tmp_path / "env")
    run(command, "demo", "--headless", "--out", "run", cwd=tmp_path)
    assert (tmp_path / "run" / "report.html").is_file()
    check_tutorial(python, tmp_path)


def clouds(folder: Path) -> list[str]:
    """Files with two clouds of a rod that moves."""
    s = np.linspace(0.0, 0.5, 800)
    names = ["cloud_0.npy", "cloud_1.npy"]
    for shift_m, name in zip((0.0, 0.01), names, strict=True):
        np.save(folder / name, np.column_stack([0.4 + shift_m + 0.02 * np.sin(12 * s), s - 0.25, np.full(800, 0.005)]))
    return names


def size_mb(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def version_of(wheel: Path) -> str:
    return wheel.name.split("-")[1]


def run(*command: str, cwd: Path, codes: tuple[int, ...] = (0,)) -> str:
    """Run a command in a folder; returns what it printed."""
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=1200)
    assert done.returncode in codes, done.stdout + done.stderr
    return done.stdout
