"""What the links of an arm look like: their meshes, or their capsules where there are none."""

from functools import cache

import numpy as np
import trimesh

from dlokit.description.arm.model import ArmModel, Capsule

_SEGMENTS = (16, 16)  # of a drawn capsule


@cache
def link_mesh(arm: ArmModel, link: str, *, merged: bool) -> trimesh.Trimesh:
    """One mesh of a link, in its frame [m]; with `merged` equal vertices are one, as smooth shading needs.

    Raises `MachineError` when the package of the arm's meshes is not installed.
    """
    surfaces = arm.surfaces.get(link, ())
    if not surfaces:
        return _joined([_capsule_mesh(each) for each in arm.capsules if each.link == link])
    parts: list[trimesh.Trimesh] = []
    for surface in surfaces:
        mesh = trimesh.load_mesh(surface.path, process=merged)
        assert isinstance(mesh, trimesh.Trimesh), f"{surface.path} holds {type(mesh).__name__}, not one mesh"
        if not np.array_equal(surface.T_link_mesh, np.eye(4)):
            mesh.apply_transform(surface.T_link_mesh)
        parts.append(mesh)
    return parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    whole = trimesh.util.concatenate(parts)
    assert isinstance(whole, trimesh.Trimesh), "meshes make a mesh"
    return whole


def _capsule_mesh(capsule: Capsule) -> trimesh.Trimesh:
    start, end = np.array(capsule.start_m), np.array(capsule.end_m)
    length_m = float(np.linalg.norm(end - start))
    mesh = trimesh.creation.capsule(height=length_m, radius=capsule.radius_m, count=_SEGMENTS)
    along = (end - start) / length_m if length_m > 0.0 else np.array([0.0, 0.0, 1.0])
    mesh.apply_transform(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], along))
    mesh.apply_translation(0.5 * (start + end))
    return mesh
