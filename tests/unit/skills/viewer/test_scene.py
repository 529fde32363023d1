from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import viser
from made_fixtures import FURNISHED, LID, POST
from unheard_page import open_unheard_page

from dlokit import geometry
from dlokit.description.scene import Scene
from dlokit.description.table import Table
from dlokit.skills.viewer import palette
from dlokit.skills.viewer.palette import Layer
from dlokit.skills.viewer.scene import ViewerScene
from dlokit.skills.viewer.serving.page import close_page
from dlokit.types.action import Candidates, Grasp, PickPlace, ScoredCandidate, VelocityProfile
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, GoalShape, TargetPoints, Topology
from dlokit.types.image import CameraCalibration, StereoImages
from dlokit.types.observation import Observation


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = open_unheard_page("127.0.0.1", 0, "key")
    yield server
    close_page(server)


@pytest.fixture
def scene(server: viser.ViserServer) -> ViewerScene:
    return ViewerScene(server, FURNISHED, 0.004)


def test_the_table_of_the_configuration_is_drawn(server: viser.ViserServer, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: dict[str, dict[str, Any]] = {}
    monkeypatch.setattr(server.scene, "add_box", lambda name, **box: drawn.update({name: box}))
    ViewerScene(server, Scene(table=Table(centre_m=(0.3, -0.1), size_m=(0.8, 0.6))), 0.004)
    assert drawn["/table/top"]["dimensions"] == (0.8, 0.6, 0.05)
    assert drawn["/table/top"]["position"] == (0.3, -0.1, -0.025)


def test_fixtures_stand_in_their_layer_with_their_names(server: viser.ViserServer, scene: ViewerScene) -> None:
    def part(name: str) -> Any:
        return server.scene.get_handle_by_name(f"/{palette.FIXTURES.slug}/{name}")

    np.testing.assert_allclose(part("A").position, POST.position_m)
    np.testing.assert_allclose(part("A").wxyz, POST.T_world_foot.wxyz)
    assert (part("A/shape").radius, part("A/shape").height) == (0.006, pytest.approx(0.024))
    # The head is a ball whose top is that of the post.
    assert part("A/shape").position[2] + part("A/shape/head").position[2] + 0.006 == pytest.approx(0.030)
    np.testing.assert_allclose(part("lid").wxyz, LID.T_world_foot.wxyz)
    assert (part("lid/shape").dimensions, part("lid/shape").position[2]) == (LID.size_m, 0.015)
    assert [part(f"{name}/name").text for name in ("A", "lid")] == ["A", "lid"]
    assert part("A/name").position[2] == 0.030
    root = server.scene.get_handle_by_name(f"/{palette.FIXTURES.slug}")
    assert root is not None
    scene.set_visible(palette.FIXTURES, False)
    assert not root.visible


def _action(predicted: Float64Array | None) -> PickPlace:
    poses = [geometry.downward((0.4, y, z), 0.3) for y, z in ((0.0, 0.01), (0.0, 0.1), (0.1, 0.1), (0.1, 0.01))]
    return PickPlace(
        stamp_ns=1,
        grasp=Grasp(node=3, T_world_tcp=poses[0]),
        path=tuple(poses[1:]),
        velocity=VelocityProfile(),
        predicted_nodes_world=predicted,
    )


def _straight(count: int) -> Float64Array:
    return np.linspace([0.5, -0.25, 0.004], [0.5, 0.25, 0.004], count)


def test_what_is_shown_is_what_messages_added_and_people_have_not_hidden(scene: ViewerScene) -> None:
    assert scene.shown == ()
    scene.show_goal(GoalShape(stamp_ns=1, nodes_world=_straight(5), name="I"))
    scene.show_cloud(Observation(stamp_ns=1, points_world=np.zeros((4, 3), dtype=np.float32)))
    assert scene.shown == (palette.GOAL, palette.CLOUD)
    scene.set_visible(palette.GOAL, False)
    assert scene.shown == (palette.CLOUD,)
    scene.clear()
    assert scene.shown == ()


@pytest.mark.parametrize("count", [2, 31])
def test_a_rod_of_any_number_of_nodes_is_drawn_and_may_change_it(scene: ViewerScene, count: int) -> None:
    topology = Topology(edges=np.zeros((0, 2), dtype=np.int64), rest_lengths_m=np.zeros(0))
    for nodes in (_straight(count), _straight(count), _straight(count + 5)):
        scene.show_state(DloState(stamp_ns=1, nodes_world=nodes, topology=topology))
        scene.show_goal(GoalShape(stamp_ns=1, nodes_world=nodes))


def test_clouds_may_be_empty_and_change_their_size(scene: ViewerScene) -> None:
    for count in (0, 50, 20, 0):
        scene.show_cloud(Observation(stamp_ns=1, points_world=np.zeros((count, 3), dtype=np.float32)))
    nodes = _straight(31)
    for visible in (np.ones(31, dtype=np.bool_), np.zeros(31, dtype=np.bool_)):
        scene.show_targets(TargetPoints(stamp_ns=1, nodes_world=nodes, visible=visible))


def test_an_action_can_be_hidden_and_another_shown_after_it(scene: ViewerScene) -> None:
    scene.hide_action()
    for predicted in (_straight(31), None):
        scene.show_action(_action(predicted))
        scene.show_action(_action(predicted))
        scene.hide_action()


def test_a_hidden_action_keeps_its_grippers_for_the_next(server: viser.ViserServer, scene: ViewerScene) -> None:
    # A browser complains of updates of removed nodes, dozens an action.
    scene.show_action(_action(_straight(31)))
    gripper = server.scene.get_handle_by_name(f"/{palette.ACTION.slug}/grasp")
    assert gripper is not None
    for visible in (False, True):
        if visible:
            scene.show_action(_action(None))
        else:
            scene.hide_action()
        assert server.scene.get_handle_by_name(gripper.name) is gripper
        assert gripper.visible is visible
        assert (server.scene.get_handle_by_name(f"/{palette.ACTION.slug}/path") is not None) is visible
    assert _shown(server, palette.ACTION) == 0


def _candidates(count: int) -> Candidates:
    best = tuple(
        ScoredCandidate(kind="drag", node=3, score_m=0.01, nodes_world=_straight(31), path_world=_straight(2))
        for _ in range(count)
    )
    return Candidates(stamp_ns=1, rollouts=16, budget=480, best=best)


def _shown(server: viser.ViserServer, layer: Layer) -> int:
    """Number of ghosts of rods in a layer of the scene."""
    parts = (*map(str, range(9)), "predicted")
    return sum(server.scene.get_handle_by_name(f"/{layer.slug}/{part}") is not None for part in parts)


def test_as_many_candidates_are_shown_as_are_considered(server: viser.ViserServer, scene: ViewerScene) -> None:
    for count in (3, 6, 2, 0):
        scene.show_candidates(_candidates(count))
        assert _shown(server, palette.CANDIDATES) == count


def test_candidates_vanish_when_the_action_is_chosen_and_the_action_when_the_next_is(
    server: viser.ViserServer, scene: ViewerScene
) -> None:
    scene.show_candidates(_candidates(3))
    scene.show_action(_action(_straight(31)))
    assert (_shown(server, palette.CANDIDATES), _shown(server, palette.ACTION)) == (0, 1)
    scene.show_candidates(_candidates(2))
    assert (_shown(server, palette.CANDIDATES), _shown(server, palette.ACTION)) == (2, 0)


def test_a_cleared_scene_shows_nothing_of_before_and_can_be_filled_again(
    server: viser.ViserServer, scene: ViewerScene
) -> None:
    def parts() -> list[bool]:
        names = (f"/{palette.GOAL.slug}/rod", f"/{palette.CLOUD.slug}/points")
        return [server.scene.get_handle_by_name(name) is not None for name in names]

    for _ in range(2):
        scene.show_goal(GoalShape(stamp_ns=1, nodes_world=_straight(31)))
        scene.show_cloud(Observation(stamp_ns=1, points_world=np.zeros((5, 3), dtype=np.float32)))
        scene.show_action(_action(_straight(31)))
        assert (parts(), _shown(server, palette.ACTION)) == ([True, True], 1)
        scene.clear()
        assert (parts(), _shown(server, palette.ACTION)) == ([False, False], 0)


def test_pictures_follow_one_another_and_every_layer_can_be_hidden(scene: ViewerScene) -> None:
    pixels = np.zeros((56, 64, 3), dtype=np.uint8)
    calibration = CameraCalibration(
        width_px=64,
        height_px=56,
        fx_px=72.0,
        fy_px=72.0,
        cx_px=31.5,
        cy_px=27.5,
        T_world_camera=geometry.pose((0.5, 0.6, 1.0)),
    )
    for _ in range(2):
        scene.show_pictures(StereoImages(stamp_ns=1, left=pixels, right=pixels, calibration=calibration))
    for layer in palette.LAYERS:
        scene.set_visible(layer, False)
