"""A URDF is read by its own encoding and prefixes, its numbers are checked, and meshes of packages are found."""

from pathlib import Path

import pytest

from dlokit.description.arm.urdf import Urdf, read_urdf
from dlokit.errors import ConfigError

JOINT = '<joint name="a" type="revolute"><parent link="b"/><child link="c"/><limit velocity="{}" effort="9"/></joint>'
LINKS = '<link name="b"/><link name="c"><collision><geometry>{}</geometry></collision></link>'
MESH = LINKS.format('<mesh filename="package://two_arms/meshes/part.stl"/>')


def urdf_of(folder: Path, body: str, head: str = "", encoding: str = "utf-8", robot: str = "<robot>") -> Urdf:
    path = folder / "arm.urdf"
    path.write_bytes((head + robot + body + "</robot>").encode(encoding))
    found = read_urdf(path)
    assert found is not None
    return found


@pytest.mark.parametrize("encoding", ["utf-8", "iso-8859-1", "utf-16", "utf-8-sig"])
def test_a_urdf_is_read_by_the_encoding_that_it_declares(tmp_path: Path, encoding: str):
    named = encoding.removesuffix("-sig")
    head = f'<?xml version="1.0" encoding="{named}"?><!-- Autor: Jürgen -->'
    assert urdf_of(tmp_path, LINKS + JOINT.format("3.1"), head, encoding).velocity_rad_s == {"a": 3.1}


def test_an_encoding_that_is_not_declared_is_named_with_what_to_do(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"cannot be read as URDF .* name the file's encoding in its first line"):
        urdf_of(tmp_path, LINKS + "<!-- Jürgen -->", encoding="iso-8859-1")


@pytest.mark.parametrize("robot", ['<robot xmlns:drake="http://drake.mit.edu">', "<robot>"])
def test_prefixes_are_kept_whether_they_are_declared_or_not(tmp_path: Path, robot: str):
    extra = '<drake:group name="g"><drake:member link="b"/></drake:group><gazebo><a foo:bar="1"/></gazebo>'
    found = urdf_of(tmp_path, LINKS + JOINT.format("3.1") + extra, robot=robot)
    assert found.velocity_rad_s == {"a": 3.1}
    assert '<drake:member link="b"/>' in found.text


@pytest.mark.parametrize("velocity", ["3,1", "${pi}", "nan", ""])
def test_a_value_that_is_no_number_is_named_with_its_joint(tmp_path: Path, velocity: str):
    with pytest.raises(ConfigError, match=r"velocity of a is .*: give a number"):
        urdf_of(tmp_path, LINKS + JOINT.format(velocity))


def test_another_description_is_left_to_mujoco(tmp_path: Path):
    (tmp_path / "arm.xml").write_text("<mujoco/>")
    assert read_urdf(tmp_path / "arm.xml") is None


@pytest.mark.parametrize(
    ("place", "variable", "value"),
    [
        ("cell/two_arms", "", ""),  # beside the description
        ("two_arms", "", ""),  # above it
        ("ws/share/two_arms", "AMENT_PREFIX_PATH", "/nowhere:{}/ws"),
        ("src/two_arms", "ROS_PACKAGE_PATH", "{}/src"),
        ("src/two_arms", "ROS_PACKAGE_PATH", "{}/src/two_arms"),
    ],
)
def test_the_meshes_of_a_package_are_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str, variable: str, value: str
):
    mesh = tmp_path / place / "meshes/part.stl"
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    (tmp_path / "cell").mkdir(exist_ok=True)
    if variable:
        monkeypatch.setenv(variable, value.format(tmp_path))
    assert f'filename="{mesh}"' in urdf_of(tmp_path / "cell", MESH).text


def test_a_package_that_is_not_found_is_named_with_what_to_do(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"no folder two_arms beside or above it.*put the folder two_arms beside"):
        urdf_of(tmp_path, MESH)
    # MuJoCo does not load visual meshes, and finds its own by a compiler's meshdir.
    assert "package://" in urdf_of(tmp_path, MESH.replace("collision", "visual")).text
    own = '<mujoco><compiler meshdir="meshes" strippath="true"/></mujoco>'
    assert "package://" in urdf_of(tmp_path, MESH + own).text
