"""Names in the scene do not lie on one another."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pytest
import viser
from unheard_page import open_unheard_page

from dlokit import geometry
from dlokit.description.scene import Fixture, Post, Scene
from dlokit.skills.viewer.labels import Labels
from dlokit.skills.viewer.scene import ViewerScene
from dlokit.skills.viewer.serving.page import close_page
from dlokit.skills.viewer.viewpoint import VISITOR_FOV_RAD, VISITOR_LOOK_AT_M, viewpoint
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

HERE = geometry.pose((0.0, 0.0, 0.0))


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = open_unheard_page("127.0.0.1", 0, "key")
    yield server
    close_page(server)


def _pixel(point: Float64Array, aspect: float) -> Float64Array:
    eye = viewpoint(aspect)
    forward = np.array(VISITOR_LOOK_AT_M) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right)])
    return axes @ (point - eye) / (forward @ (point - eye)) * 400.0 / np.tan(VISITOR_FOV_RAD / 2.0)


def _box(label: Any, point: Float64Array, aspect: float) -> tuple[Float64Array, Float64Array]:
    """Upper left and lower right corner (2,) each [px], as measured on a picture of viser 1.1 at 12 px a letter."""
    size = label.font_screen_scale * np.array([5.0 + 5.8 * len(label.text), 17.0])
    vertical, horizontal = label.anchor.split("-")
    at = np.array(
        [
            {"left": 0.0, "center": -0.5, "right": -1.0}[horizontal],
            {"top": 0.0, "center": -0.5, "bottom": -1.0}[vertical],
        ]
    )
    corner = _pixel(point, aspect) + at * size
    return corner, corner + size


def _check_apart(labels: Sequence[tuple[Any, Float64Array]], aspect: float) -> None:
    boxes = [(label.text, *_box(label, point, aspect)) for label, point in labels]
    for (one, low, high), (other, least, most) in combinations(boxes, 2):
        assert np.any((high <= least) | (most <= low)), f"{one} and {other} lie on one another"


def _found(server: viser.ViserServer, node: str, parent_m: Float64Array) -> tuple[Any, Float64Array]:
    label: Any = server.scene.get_handle_by_name(node)
    return label, parent_m + label.position


@pytest.mark.parametrize("aspect", [1.4, 0.85])
def test_frames_arms_and_fixtures_at_one_place_have_names_that_can_be_read(
    server: viser.ViserServer, aspect: float
) -> None:
    labels = Labels(server.scene)
    poses: list[tuple[str, Pose]] = [("installation", HERE), ("world", HERE), ("left", HERE)]
    poses += [(name, geometry.pose((x, 0.0, 0.0))) for name, x in (("A", 0.01), ("B", 0.02), ("lid", 0.03))]
    for name, T in poses:
        labels.add(f"/names/{name}", name, T)
    _check_apart([_found(server, f"/names/{name}", T.position_m) for name, T in poses], aspect)


def test_a_name_that_covers_no_other_is_above_its_point(server: viser.ViserServer) -> None:
    labels = Labels(server.scene)
    labels.add("/a", "A", HERE)
    labels.add("/b", "B", geometry.pose((0.5, 0.2, 0.0)), height_m=0.1)
    for name, height_m in (("/a", 0.0), ("/b", 0.1)):
        label: Any = server.scene.get_handle_by_name(name)
        assert (label.anchor, label.position[2]) == ("bottom-center", height_m)


def _row(gap_m: float) -> tuple[Fixture, ...]:
    return tuple(Post(name=f"post_{i}", position_m=(0.45, -0.1 + i * gap_m, 0.0), diameter_m=0.008) for i in range(4))


@pytest.mark.parametrize("gap_m", [0.012, 0.05])
def test_the_names_of_near_fixtures_and_of_the_frames_are_in_the_scene(server: viser.ViserServer, gap_m: float) -> None:
    fixtures = _row(gap_m)
    ViewerScene(server, Scene(fixtures=fixtures), 0.004, HERE)
    labels = [_found(server, f"/fixtures/{one.name}/name", np.array(one.position_m)) for one in fixtures]
    labels += [_found(server, f"/{frame}/name", np.zeros(3)) for frame in ("installation", "world")]
    assert len(labels) == 6
    _check_apart(labels, 1.4)
