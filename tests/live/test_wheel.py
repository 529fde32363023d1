"""What is in the wheel that a user installs, and what it asks for; `long/test_distribution.py` installs it."""

import re
import zipfile
from importlib.metadata import PathDistribution
from pathlib import Path

import pytest
from built_wheel import ROOT, built_wheel, version_of
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

pytestmark = pytest.mark.smoke
SOURCES = {
    str(path.relative_to(ROOT / "src"))
    for path in (ROOT / "src").rglob("*")
    if path.is_file() and "__pycache__" not in path.parts
}
HARDWARE = {"pyrealsense2", "pygobject", "aravis-python", "visiontransfer", "airo-models", "rtb-data"}
"""Packages for one device or arm, by their normalised names; drivers of arms will be among them."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built_wheel(tmp_path_factory.mktemp("dist"))


def test_the_wheel_has_all_sources_and_the_licence_and_no_tests(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    packed = {name for name in names if name.startswith("dlokit/")}
    assert packed == SOURCES
    metadata = f"dlokit-{version_of(wheel)}.dist-info"
    assert f"{metadata}/licenses/LICENSE" in names
    assert {name.split("/")[0] for name in names} == {"dlokit", metadata}


def test_the_plain_install_pulls_no_package_for_hardware_and_every_extra_comes_from_a_registry(wheel: Path) -> None:
    info = zipfile.Path(wheel, f"dlokit-{version_of(wheel)}.dist-info/")
    required = [Requirement(text) for text in PathDistribution(info).requires or ()]  # pyright: ignore[reportArgumentType]
    extras = {extra for each in required for extra in _extras_of(each)}
    plain = {canonicalize_name(each.name) for each in required if not _extras_of(each)}

    assert {"realsense", "genicam", "scenescan", "arms", "cell"} <= extras
    assert not plain & HARDWARE
    assert not plain & {"mujoco", "opencv-python-headless", "eclipse-zenoh", "rosbags"}
    of = {extra: {canonicalize_name(each.name) for each in required if extra in _extras_of(each)} for extra in extras}
    assert of["cell"] & HARDWARE == {"rtb-data"}  # the meshes of the simulated Panda
    assert [each for each in required if each.url] == []  # no addresses beside the registry
    assert of["ros2"] - of["cell"] == {"rosbags"}  # nothing of ROS itself
    for extra in ("realsense", "genicam", "scenescan", "arms", "ros2"):
        # A camera or an arm is of no use without perception, viewer and motions.
        assert of["cell"] <= of[extra], extra


def _extras_of(required: Requirement) -> set[str]:
    """The extras under which something is required; empty: always."""
    return set(re.findall(r"extra == ['\"]([a-z0-9]+)['\"]", str(required.marker or "")))
