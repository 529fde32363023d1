"""Reads a URDF file: decodes its declared encoding, checks its numbers, and finds its `package://` meshes.

MuJoCo reads the arm itself (`arm_file`), but ignores velocity limits, does not check for effort below 0, does not find
ROS packages, and takes an angle of 90 degrees as 90 rad. Its errors name a line of XML, ours the joint and the value;
MuJoCo alone handles 32 of the 39 mistakes of `test_arm_mistakes` as well.
"""

import math
import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.dom import expatbuilder
from xml.parsers.expat import ExpatError

from dlokit.errors import ConfigError

_THREE = frozenset(("xyz", "rpy", "size", "scale"))
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_ONE = frozenset(("lower", "upper", "velocity", "effort", "value", "radius", "length", *_INERTIA))
"""Attributes that are three numbers, and one."""


@dataclass(frozen=True, kw_only=True)
class Urdf:
    """The content of a URDF."""

    text: str
    """The description for MuJoCo, with the `package://` addresses of meshes replaced by file paths."""
    velocity_rad_s: dict[str, float]
    effort_nm: dict[str, float]
    """Limits by joint, where the description has them."""
    continuous: frozenset[str]
    """The joints that turn without a limit."""


def read_urdf(path: Path) -> Urdf | None:
    """Read a URDF; None if the file is another description. Raises `ConfigError` on invalid numbers."""
    try:
        # Without namespaces, because descriptions often use prefixes that they do not declare.
        root: Any = expatbuilder.parse(str(path), namespaces=False).documentElement
    except (ExpatError, ValueError, LookupError) as error:  # the last two: an encoding that Python does not support
        raise ConfigError(
            f"{path} cannot be read as URDF or MJCF: {error}; correct the line, or name the file's encoding in its "
            'first line: <?xml version="1.0" encoding="ISO-8859-1"?>.'
        ) from error
    if root.tagName != "robot":
        return None
    parts = [each for each in root.childNodes if each.nodeName in ("link", "joint")]
    names = Counter((part.nodeName, part.getAttribute("name")) for part in parts)
    found: dict[str, dict[str, float]] = {"velocity": {}, "effort": {}}
    for part in parts:
        name = part.getAttribute("name")
        if names[part.nodeName, name] > 1:
            raise ConfigError(f"{path} has the {part.nodeName} {name} twice; give each a name of its own.")
        for element in part.getElementsByTagName("*"):
            link = element.getAttribute("link")
            if element.tagName in ("parent", "child") and ("link", link) not in names:
                raise ConfigError(f"the joint {name} of {path} names the link {link}, which is not in the file.")
            for attribute in sorted(element.attributes.keys() & (_THREE | _ONE)):
                values = _numbers(element, attribute, name, path)
                if attribute in found:
                    found[attribute][name] = values[0]
    continuous = frozenset(each.getAttribute("name") for each in parts if each.getAttribute("type") == "continuous")
    compilers = root.getElementsByTagName("compiler")
    if not any(each.getAttribute("strippath") == "true" for each in compilers):
        _find_meshes(root, path)
    return Urdf(text=root.toxml(), velocity_rad_s=found["velocity"], effort_nm=found["effort"], continuous=continuous)


def _numbers(element: Any, attribute: str, name: str, path: Path) -> list[float]:
    """The numbers of an attribute of the joint or link `name`."""
    text = element.getAttribute(attribute)
    wanted = "numbers" if (several := attribute in _THREE) else "a number"
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) == (3 if several else 1) and all(map(math.isfinite, values)):
        if attribute != "rpy" or max(map(abs, values)) <= 2.0 * math.pi + 0.01:
            return values
        wanted = "radians"
    what = attribute if element.tagName == "limit" else f"{element.tagName} {attribute}"
    raise ConfigError(f"{what} of {name} is {text}: give {wanted} ({path}).")


def _find_meshes(root: Any, path: Path) -> None:
    """Replace `package://NAME/…` by the file. Raises `ConfigError` for a collision mesh whose folder is not found."""
    for mesh in root.getElementsByTagName("mesh"):
        address = mesh.getAttribute("filename")
        if not address.startswith("package://"):
            continue
        inside = address.removeprefix("package://")
        package = inside.split("/")[0]
        ament, ros = (_folders(name) for name in ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"))
        folders = (*path.resolve().parents, *(each / "share" for each in ament), *ros, *(each.parent for each in ros))
        file = next((folder / inside for folder in folders if (folder / inside).is_file()), None)
        if file is not None:
            mesh.setAttribute("filename", str(file))
        elif mesh.parentNode.parentNode.nodeName == "collision":  # MuJoCo leaves visual meshes out
            raise ConfigError(
                f"{path} names the mesh {address}, which is in no folder {package} beside or above it, nor in those of "
                f"AMENT_PREFIX_PATH and ROS_PACKAGE_PATH; put the folder {package} beside the description, or source "
                "the ROS workspace that has it."
            )


def _folders(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each]
