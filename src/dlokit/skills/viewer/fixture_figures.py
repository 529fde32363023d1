"""The fixtures in the scene: posts and boxes with their names, where they are believed to stand."""

from collections.abc import Sequence

import viser

from dlokit.description.scene import Box, Fixture
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.labels import Labels
from dlokit.skills.viewer.robot_figure import place

_LETTERS = 0.75
"""Size of a name relative to the other labels of the page: fixtures are small and may be many."""


def add_fixtures(scene: viser.SceneApi, labels: Labels, root: str, fixtures: Sequence[Fixture]) -> None:
    """Add a figure with its name for each fixture, below the frame `root`."""
    for fixture in fixtures:
        name = f"{root}/{fixture.name}"
        place(scene.add_frame(name, show_axes=False), fixture.T_world_foot)
        height_m = _add_shape(scene, f"{name}/shape", fixture)
        labels.add(f"{name}/name", fixture.name, fixture.T_world_foot, height_m=height_m, size=_LETTERS)


def _add_shape(scene: viser.SceneApi, name: str, fixture: Fixture) -> float:
    """Add the shape of a fixture, which stands in the origin of its frame; returns its height [m]."""
    color = palette.FIXTURES.color
    if isinstance(fixture, Box):
        middle = (0.0, 0.0, fixture.size_m[2] / 2.0)
        scene.add_box(name, color, dimensions=fixture.size_m, position=middle)
        return fixture.size_m[2]
    radius_m = fixture.diameter_m / 2.0
    straight_m = fixture.height_m - radius_m
    scene.add_cylinder(name, radius_m, straight_m, color, position=(0.0, 0.0, straight_m / 2.0))
    scene.add_icosphere(f"{name}/head", radius_m, color, position=(0.0, 0.0, straight_m / 2.0))
    return fixture.height_m
