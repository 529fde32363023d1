"""Goals dragged by frames: forces pull, the rod does the rest."""

import numpy as np
import pytest

from dlokit.description.shapes import builtin_shape
from dlokit.geometry import arc_lengths
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.model.goal import GoalRod
from dlokit.types.flow import GoalFrame

CONFIG = BelievedDlo()
START = builtin_shape("I", CONFIG.length_m, CONFIG.nodes)
FRAMES = (
    GoalFrame(node=3, x_m=0.45, y_m=-0.15),
    GoalFrame(node=15, x_m=0.56, y_m=0.0, yaw_rad=np.deg2rad(60)),
    GoalFrame(node=27, x_m=0.45, y_m=0.15),
)


def dragged(frames: tuple[GoalFrame, ...]) -> np.ndarray:
    """The nodes (M, 3) [m] of a rod that frames have pulled until it rests."""
    rod = GoalRod(CONFIG)
    rod.place(START)
    for _ in range(10):
        rod.drag(frames)
    return rod.nodes_world


def test_frames_pull_their_nodes_to_them() -> None:
    nodes = dragged(FRAMES)
    for frame in FRAMES:
        # Springs against a soft rod: what is left is the bending force over the spring's stiffness.
        assert np.hypot(*(nodes[frame.node, :2] - (frame.x_m, frame.y_m))) < 0.004


def test_a_frame_with_yaw_turns_the_rod() -> None:
    nodes = dragged(FRAMES)
    along = nodes[16, :2] - nodes[14, :2]
    assert np.arctan2(along[1], along[0]) == pytest.approx(np.deg2rad(60), abs=np.deg2rad(5))


def test_a_goal_obeys_the_rod_even_when_frames_ask_for_more() -> None:
    apart = (GoalFrame(node=0, x_m=0.5, y_m=-0.5), GoalFrame(node=30, x_m=0.5, y_m=0.5))
    nodes = dragged(apart)
    assert arc_lengths(nodes)[-1] == pytest.approx(CONFIG.length_m, rel=0.01)


def test_ends_pushed_together_bow_out_in_the_plane_of_the_table() -> None:
    together = (
        GoalFrame(node=0, x_m=0.52, y_m=-0.15),
        GoalFrame(node=15, x_m=0.6, y_m=0.0),
        GoalFrame(node=30, x_m=0.52, y_m=0.15),
    )
    nodes = dragged(together)
    assert np.all(nodes[:, 2] == CONFIG.radius_m)
    assert np.hypot(*(nodes[30, :2] - nodes[0, :2])) == pytest.approx(0.3, abs=0.01)
    # Forced flat, it must still have its length: it did not escape upwards unseen.
    assert arc_lengths(nodes)[-1] == pytest.approx(CONFIG.length_m, rel=0.01)


def test_dragging_is_incremental() -> None:
    rod = GoalRod(CONFIG)
    rod.place(START)
    first = rod.drag(FRAMES[:1])
    second = rod.drag(FRAMES[:1])
    target = (FRAMES[0].x_m, FRAMES[0].y_m)
    assert np.hypot(*(second[3, :2] - target)) <= np.hypot(*(first[3, :2] - target)) + 1e-4
    assert np.linalg.norm(first - START) > 0.01
