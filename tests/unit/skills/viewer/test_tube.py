import numpy as np
import trimesh

from dlokit.description.shapes import builtin_shape
from dlokit.skills.viewer.scene import tube_faces, tube_vertices
from dlokit.types.arrays import Float64Array

SIDES = 12


def _mesh(nodes: Float64Array, radius_m: float) -> trimesh.Trimesh:
    return trimesh.Trimesh(tube_vertices(nodes, radius_m, SIDES), tube_faces(len(nodes), SIDES), process=False)


def test_a_tube_is_closed_and_faces_outwards_with_the_volume_of_its_prism() -> None:
    nodes = np.linspace([0.3, -0.2, 0.004], [0.3, 0.2, 0.004], 9)
    mesh = _mesh(nodes, 0.004)
    assert mesh.is_watertight
    area = SIDES / 2 * np.sin(2 * np.pi / SIDES) * 0.004**2
    # Vertices are single precision: at 0.3 m that is 3e-8 m in a radius of 4e-3 m.
    np.testing.assert_allclose(mesh.volume, area * 0.4, rtol=1e-4)


def test_every_ring_lies_at_the_radius_around_its_node_without_twist() -> None:
    nodes = builtin_shape("S", 0.5, 31)
    rings = tube_vertices(nodes, 0.004, SIDES)[:-2].reshape(31, SIDES, 3)
    np.testing.assert_allclose(np.linalg.norm(rings - nodes[:, None], axis=2), 0.004, atol=1e-7)
    # Corner k of neighbouring rings is about one node spacing apart (16.7 mm; bends add up to a radius): no twist.
    assert np.linalg.norm(np.diff(rings, axis=0), axis=2).max() < 0.0167 + 0.004


def test_a_tube_that_stands_upright_and_turns_back_has_no_broken_numbers() -> None:
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.0, 0.0, 0.2], [0.0, 0.1, 0.2], [0.0, 0.1, 0.1]])
    assert np.isfinite(tube_vertices(nodes, 0.01, SIDES)).all()
