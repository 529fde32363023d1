"""A look at the fixtures of the simulated cell, of which some do not stand as believed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
import pytest

from dlokit import geometry
from dlokit.description.arm.franka import PANDA
from dlokit.description.installation import Installation
from dlokit.description.scene import Box, Fixture, Post
from dlokit.functional.cell import fixtures as cell_fixtures
from dlokit.functional.cell.arm import ArmPosture
from dlokit.functional.cell.config import CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.config import BoxConfig, PerceptionConfig
from dlokit.skills.perception.fixture_check import check_fixtures
from dlokit.skills.perception.pipeline import corrected_camera_pose
from dlokit.types.fixtures import FixtureCheck, FixtureFinding, FixtureSight
from dlokit.types.image import CameraPictures
from dlokit.types.pose import Pose
from dlokit.types.robot import FIRST_ROBOT

CONFIG = PerceptionConfig()
A = Post(name="A", position_m=(0.45, -0.15, 0.0))
B = Post(name="B", position_m=(0.55, -0.05, 0.0), diameter_m=0.014, height_m=0.04)
C = Post(name="C", position_m=(0.45, 0.10, 0.0))
D = Box(name="D", position_m=(0.62, 0.15, 0.0), rpy_deg=(0.0, 0.0, 30.0), size_m=(0.03, 0.05, 0.04))
BELIEVED = (A, B, C, D)
AWAY = ((0.85, -0.25), (0.85, 0.25))


@dataclass(frozen=True, kw_only=True)
class Taken:
    """Pictures of a cell, and its arm."""

    pictures: list[CameraPictures]
    robots: tuple[PosedArm, ...]

    def with_pose(self, T_world_camera: Pose) -> "Taken":
        return replace(self, pictures=[placed(one, T_world_camera) for one in self.pictures])

    def check(
        self, believed: Sequence[Fixture] = BELIEVED, config: PerceptionConfig = CONFIG, *, pose_known: bool = False
    ) -> FixtureCheck:
        return check_fixtures(self.pictures, self.robots, config, config.segmentation, believed, pose_known=pose_known)


def placed(images: CameraPictures, T_world_camera: Pose) -> CameraPictures:
    calibration = msgspec.structs.replace(images.calibration, T_world_camera=T_world_camera)
    return msgspec.structs.replace(images, calibration=calibration)


def look(
    true: Sequence[Fixture],
    *,
    rope: Sequence[Sequence[float]] = AWAY,
    depth: bool = False,
    q_rad: Sequence[float] | None = None,
    corrected: bool = True,
) -> Taken:
    """Pictures of a cell with these fixtures, their pose corrected by the table."""
    cell = Cell(CellConfig(fixtures=tuple(true), settle_s=0.0), seed=3, installation=Installation(fixtures=BELIEVED))
    cell.place_dlo(np.array(rope), settle=False)
    if q_rad is not None:
        cell.show(cell.true_nodes_world(), {FIRST_ROBOT: ArmPosture(q_rad=np.array(q_rad), finger_width_m=0.04)})
    taken = Taken(
        pictures=[cell.capture_depth() for _ in range(6)] if depth else [cell.capture()],
        robots=(PosedArm(PANDA, cell.arm_state()),),
    )
    cell.close()
    if not corrected:
        return taken
    pose = corrected_camera_pose(taken.pictures[0], taken.robots, CONFIG, CONFIG.segmentation, BELIEVED)
    assert pose is not None
    return taken.with_pose(pose)


def wrong(check: FixtureCheck) -> dict[str, FixtureSight]:
    return {one.name: one.sight for one in check.findings if one.sight is not FixtureSight.AS_BELIEVED}


def finding(check: FixtureCheck, name: str) -> FixtureFinding:
    return next(one for one in check.findings if one.name == name)


def moved(fixture: Fixture, x_m: float, y_m: float) -> Fixture:
    x, y, z = fixture.position_m
    return replace(fixture, position_m=(x + x_m, y + y_m, z))


@pytest.fixture(scope="module")
def as_believed() -> Taken:
    return look(BELIEVED)


def test_fixtures_that_stand_as_believed_are_seen_there(as_believed: Taken):
    check = as_believed.check()
    assert [one.name for one in check.findings] == ["A", "B", "C", "D"]
    assert wrong(check) == {}
    assert all(np.linalg.norm(one.offset_m) < 0.004 for one in check.findings)


@pytest.mark.parametrize("depth", [False, True])
@pytest.mark.parametrize(("x_m", "y_m"), [(0.015, 0.0), (-0.009, -0.012), (0.0, 0.015)])
def test_a_fixture_moved_by_15_mm_is_named_with_its_offset(x_m: float, y_m: float, depth: bool):
    check = look((moved(A, x_m, y_m), B, C, D), depth=depth).check()
    assert wrong(check) == {"A": FixtureSight.MOVED}
    np.testing.assert_allclose(finding(check, "A").offset_m, [x_m, y_m], atol=0.004)
    np.testing.assert_allclose(finding(check, "A").place_world, np.add(A.position_m[:2], [x_m, y_m]), atol=0.004)


@pytest.mark.parametrize("depth", [False, True])
def test_a_fixture_that_is_not_there_is_missing_and_one_that_none_believes_in_is_unknown(depth: bool):
    other = Post(name="other", position_m=(0.35, 0.25, 0.0), diameter_m=0.02, height_m=0.05)
    check = look((A, B, D, other), depth=depth).check()
    assert wrong(check) == {"C": FixtureSight.MISSING, "": FixtureSight.UNKNOWN}
    unknown = finding(check, "")
    np.testing.assert_allclose(unknown.place_world, other.position_m[:2], atol=0.012)
    np.testing.assert_allclose(unknown.larger_m, (0.02, 0.05), atol=0.012)


@pytest.mark.parametrize("depth", [False, True])
def test_two_exchanged_posts_of_different_size_are_named(depth: bool):
    exchanged = (moved(A, 0.1, 0.1), moved(B, -0.1, -0.1), C, D)
    found = wrong(look(exchanged, depth=depth).check())
    assert {"A", "B"} <= found.keys()
    assert FixtureSight.OTHER_SIZE in found.values()


def test_a_post_that_looks_much_higher_alone_has_another_size():
    found = wrong(look((A, B, replace(C, height_m=0.06), D)).check())
    assert found["C"] in (FixtureSight.OTHER_SIZE, FixtureSight.MOVED)


@pytest.mark.parametrize("depth", [False, True])
def test_a_rope_against_a_post_does_not_spoil_it(depth: bool):
    touching = [[0.46, -0.27], [0.46, 0.23]]
    assert wrong(look(BELIEVED, rope=touching, depth=depth).check()) == {}


def test_a_common_shift_of_three_fixtures_and_more_is_the_cameras_error(as_believed: Taken):
    T = as_believed.pictures[0].calibration.T_world_camera
    shifted = as_believed.with_pose(geometry.pose(T.position_m + np.array([0.006, -0.006, 0.0]), T.wxyz))
    check = shifted.check()
    assert wrong(check) == {}
    np.testing.assert_allclose(check.camera_offset_m, [0.006, -0.006], atol=0.004)


def test_with_a_camera_that_the_hand_has_corrected_a_common_shift_is_the_fixtures_own():
    cell_camera = Cell(CellConfig(), seed=3).rig.true_calibration.T_world_camera
    true = look([moved(one, 0.008, 0.006) for one in BELIEVED], corrected=False).with_pose(cell_camera)
    assert wrong(true.check(pose_known=True)) == dict.fromkeys("ABCD", FixtureSight.MOVED)
    assert wrong(true.check()) == {}


def test_fixtures_behind_the_arm_out_of_the_box_or_too_low_are_not_seen(as_believed: Taken):
    over_table = (-0.1, 0.35, 0.05, -2.2, 0.0, 2.5, 0.8)
    found = wrong(look(BELIEVED, q_rad=over_table).check())
    assert found
    assert set(found.values()) == {FixtureSight.NOT_SEEN}
    near = replace(CONFIG, box=BoxConfig(lower_world=(0.2, -0.5, -0.02), upper_world=(0.58, 0.45, 0.25)))
    assert wrong(as_believed.check(config=near)) == {"D": FixtureSight.NOT_SEEN}
    low = replace(C, position_m=(0.35, 0.25, 0.0), height_m=0.012)
    assert wrong(as_believed.check((*BELIEVED, replace(low, name="low")))) == {"low": FixtureSight.NOT_SEEN}


def test_a_bright_post_is_a_fixture_and_not_a_piece_of_the_rope(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cell_fixtures, "_wood", lambda: np.full((64, 64, 3), 230, dtype=np.uint8))
    assert wrong(look((A, moved(B, 0.0, 0.015), C, D)).check()) == {"B": FixtureSight.MOVED}


def test_without_believed_fixtures_everything_that_stands_there_is_unknown(as_believed: Taken):
    check = as_believed.check(())
    assert [one.sight for one in check.findings] == [FixtureSight.UNKNOWN] * 4
