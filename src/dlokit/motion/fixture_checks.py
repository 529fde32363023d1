"""Checks that an arm keeps clear of fixtures while it moves, between the samples of a trajectory too. Pure."""

import itertools
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dlokit.description.arm.model import FINGER_LINKS, ArmModel
from dlokit.description.scene import Fixture
from dlokit.errors import SkillFailure
from dlokit.motion.collisions import COLLISION_STEP_RAD, thinned_rows
from dlokit.motion.fixture_clearance import (
    FIXTURE_CLEARANCE_M,
    RESOLUTION_M,
    arm_parts,
    arm_solids,
    corner_distances,
    fixture_solids,
    gaps_m,
    part_links,
)
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose
from dlokit.types.robot import RobotReason


def check_fixtures_clear(
    arm: ArmModel,
    q_rad: ArrayLike,
    widths_m: ArrayLike,
    fixtures: tuple[Fixture, ...],
    T_world_base: Pose | None = None,
    *,
    may_leave: bool = True,
) -> None:
    """Check that an arm keeps `FIXTURE_CLEARANCE_M` from all fixtures. Raises `SkillFailure` ``fixture_collision``.

    It moves in straight lines through joint angles `q_rad` (K, J) [rad] and widths between the fingertips (K,) [m];
    where only one of either is given, it does not change. With `may_leave` a part that is nearer to a fixture at the
    start may move away from it, but not come nearer.

    Let a part be d0 and d1 away from a fixture at two postures, and let its points travel at most s from one to the
    other. A point that has travelled t of it is at least d0 - t and at least d1 - (s - t) away: in between, the part is
    never nearer than (d0 + d1 - s) / 2. Each joint adds its turn times the largest distance of the part from its axis
    to s. Intervals in which the bound is below the allowed distance are halved until it is not, or a posture between is
    too near: s halves too, so that this ends where the bound is within `RESOLUTION_M` of the distance.
    """
    if not fixtures:
        return
    solids = fixture_solids(fixtures)
    q_rad, widths_m = np.atleast_2d(q_rad), np.reshape(widths_m, (-1, 1))
    count = max(len(q_rad), len(widths_m))
    postures = np.hstack([np.broadcast_to(each, (count, each.shape[1])) for each in (q_rad, widths_m)])
    turned = np.vstack((np.zeros(postures.shape[1]), np.cumsum(np.abs(np.diff(postures, axis=0)), axis=0)))
    rows = thinned_rows(postures, COLLISION_STEP_RAD).astype(np.float64)
    gaps = _gaps_m(arm, _at(postures, rows), solids, T_world_base)
    allowed = np.minimum(FIXTURE_CLEARANCE_M, gaps[0] - RESOLUTION_M if may_leave else np.inf)
    low, high, at_low, at_high = rows[:-1], rows[1:], gaps[:-1], gaps[1:]
    while True:
        _refuse_near(arm, gaps, allowed, fixtures)
        travel = (_at(turned, high) - _at(turned, low)) @ _levers(arm).T
        bound = (at_low + at_high - travel[..., None]) / 2.0  # (n, P, F)
        split = np.any(bound < allowed - RESOLUTION_M, axis=(1, 2))
        if not np.any(split):
            return
        low, high, at_low, at_high = low[split], high[split], at_low[split], at_high[split]
        middle = (low + high) / 2.0
        gaps = _gaps_m(arm, _at(postures, middle), solids, T_world_base)
        low, high = np.concatenate((low, middle)), np.concatenate((middle, high))
        at_low, at_high = np.concatenate((at_low, gaps)), np.concatenate((gaps, at_high))


def _gaps_m(arm: ArmModel, postures: Float64Array, solids: Float64Array, T_world_base: Pose | None) -> Float64Array:
    return gaps_m(arm_solids(arm, postures[:, :-1], postures[:, -1], T_world_base), solids)


def _at(values: Float64Array, rows: Float64Array) -> Float64Array:
    """Values (n, …) between the rows of `values` (K, …), at fractional row numbers (n,)."""
    before = np.minimum(rows.astype(np.int64), max(len(values) - 2, 0))
    after = np.minimum(before + 1, len(values) - 1)
    return values[before] + (rows - before)[:, None] * (values[after] - values[before])


def _refuse_near(arm: ArmModel, gaps: Float64Array, allowed: Float64Array, fixtures: tuple[Fixture, ...]) -> None:
    short = gaps - allowed
    if np.all(short >= 0.0):
        return
    _, part, fixture = np.unravel_index(int(np.argmin(short)), short.shape)
    raise SkillFailure(
        RobotReason.FIXTURE_COLLISION,
        f"{part_links(arm)[part]} would come to {max(float(gaps[..., part, fixture].min()), 0.0) * 1e3:.1f} mm from "
        f"the fixture {fixtures[fixture].name}, at least {FIXTURE_CLEARANCE_M * 1e3:.1f} mm are allowed; go over it or "
        "around it, open the fingers less, or correct its pose",
    )


@lru_cache(maxsize=16)
def _levers(arm: ArmModel) -> Float64Array:
    """Upper bounds (P, J + 1) [m] of the distance of each part from each joint's axis, and of its travel per width."""
    links, T_link_part, half, _ = arm_parts(arm)
    gripper, joints = arm.gripper, np.arange(1, len(arm.joints) + 1)
    steps = [np.zeros(3), *(joint.T_parent_link[:3, 3] for joint in arm.joints), arm.T_last_hand[:3, 3]]
    along = np.cumsum([float(np.linalg.norm(step)) for step in steps])
    finger_m = along[-1] + np.hypot(gripper.open_width_m / 2.0, gripper.finger_m + gripper.largest_tip_drop_m)
    along, link = np.array([*along, finger_m, finger_m]), np.array(links)[:, None]
    levers = along[link] - along[joints] + corner_distances(T_link_part, half, axes=3)[:, None]
    slopes = (abs((b[1] - a[1]) / (b[0] - a[0])) for a, b in itertools.pairwise(gripper.tip_drop))
    per_width = np.where(np.isin(part_links(arm), FINGER_LINKS), 0.5 + max(slopes, default=0.0), 0.0)
    return np.column_stack((np.where(link >= joints, levers, 0.0), per_width))
