"""The scene around the DLO: the table, the arms, and the fixtures among which DLOs are laid.

There are two scenes: the one that the system believes, from the installation file, and the simulated cell's true one. A
fixture stands on the table and is measured there: its pose is in the world, whose z axis is the normal of the table's
top (decision 23), even where the installation's frame is another.
"""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
import scipy
from msgspec import Meta

from dlokit import geometry
from dlokit.description.arm.mounts import FIRST_ALONE, ArmMount
from dlokit.description.table import TABLE_TOP_M, Table
from dlokit.errors import ConfigError
from dlokit.ranges import NotNegative, check_ranges
from dlokit.types.arrays import Float64Array
from dlokit.types.pose import Pose

NO_POSTS = np.zeros((0, 8))
"""`Scene.posts_world` without posts."""
NO_EDGES = np.zeros((0, 2, 3))
"""`Scene.edges_world` without fixtures."""
Size = Annotated[float, Meta(gt=0.0, le=2.0)]
"""A length of a fixture [m]: a greater one than a table's is a number of millimetres."""
_NAME = re.compile(r"[A-Za-z0-9_]{1,20}")
_STANDS_M = 0.002  # the middle of a foot may be this far above or below the table's top [m]
_UPRIGHT_DEG = 20.0  # a post leans by no more: the mechanics of the rod know upright posts
_ROUNDING_DEG = 1e-6
_SUNK_M = 0.005  # no corner of a box is further below the table's top: a wide box inclined by 1° reaches half of it [m]
_ROUND = 24  # corners of a drawn circle
_SMALLEST_M = 1e-9  # a shorter line has no direction


@dataclass(frozen=True, kw_only=True)
class StandingFixture:
    """What every fixture has: a name and a pose on the table."""

    name: str
    """Its name in messages and in `--beside`: letters, digits and _."""
    position_m: tuple[float, float, float]
    """Middle of its foot in the world [m]; z is 0 on the table."""
    rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw: turns about the x, the y, then the z axis of the world [°]."""
    friction: NotNegative = 0.3
    """Coefficient of friction between it and the DLO."""

    def __post_init__(self) -> None:
        check_ranges(self, f"the fixture {self.name}:")
        if not _NAME.fullmatch(self.name):
            raise ConfigError(f"the name of a fixture is {self.name!r}; use up to 20 letters, digits and _.")

    @cached_property
    def T_world_foot(self) -> Pose:
        """Its pose: origin in the middle of its foot, z upwards along it."""
        return geometry.pose_from_angles(self.position_m, self.rpy_deg)


@dataclass(frozen=True, kw_only=True)
class Post(StandingFixture):
    """A round post or peg, around which a DLO is laid."""

    kind: ClassVar[str] = "post"
    diameter_m: Size = 0.01
    """Its diameter [m]."""
    height_m: Size = 0.025
    """Its height over its foot [m]; its head is rounded, so that this is at least half of its diameter."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.height_m < self.diameter_m / 2.0:
            raise ConfigError(
                f"the post {self.name} has height_m {self.height_m:g} and diameter_m {self.diameter_m:g}; the height "
                "of a post is at least half of its diameter: describe a flat one as a box."
            )
        leans_deg = float(np.degrees(np.arccos(np.clip(geometry.rotation(self.T_world_foot)[2, 2], -1.0, 1.0))))
        if leans_deg > _UPRIGHT_DEG + _ROUNDING_DEG:
            raise ConfigError(
                f"the post {self.name} leans by {leans_deg:.0f}°; at most {_UPRIGHT_DEG:.0f}° are allowed: correct its "
                "rpy_deg, or describe it as a box."
            )

    @property
    def top_m(self) -> float:
        """Height of its highest point over the table [m]."""
        leaning = geometry.rotation(self.T_world_foot)[2, 2]
        sideways = np.sqrt(max(0.0, 1.0 - leaning**2))
        return float(self.position_m[2] + leaning * self.height_m + sideways * self.diameter_m / 2.0)

    @property
    def corners_world(self) -> Float64Array:
        """Corners (8, 3) [m] of the box around it."""
        return _corners(self.T_world_foot, (self.diameter_m, self.diameter_m, self.height_m))

    @property
    def rims_world(self) -> Float64Array:
        """Its foot and its top as drawn (2, K, 3) [m], each once around."""
        angles = np.linspace(0.0, 2.0 * np.pi, _ROUND, endpoint=False)
        around = self.diameter_m / 2.0 * np.column_stack((np.cos(angles), np.sin(angles)))
        rims = [np.column_stack((around, np.full(_ROUND, z))) for z in (0.0, self.height_m)]
        return np.stack([geometry.transform(self.T_world_foot, rim) for rim in rims])


@dataclass(frozen=True, kw_only=True)
class Box(StandingFixture):
    """A block that arm and DLO keep clear of."""

    kind: ClassVar[str] = "box"
    size_m: tuple[Size, Size, Size] = (0.05, 0.05, 0.05)
    """Its extent along its own x, y and z [m]."""

    @property
    def top_m(self) -> float:
        """Height of its highest point over the table [m]."""
        return float(self.corners_world[:, 2].max())

    @property
    def corners_world(self) -> Float64Array:
        """Its corners (8, 3) [m]."""
        return _corners(self.T_world_foot, self.size_m)

    @property
    def rims_world(self) -> Float64Array:
        """Its lower and its upper side (2, 4, 3) [m], each once around."""
        return self.corners_world[[(0, 2, 6, 4), (1, 3, 7, 5)]]


Fixture = Post | Box
"""Every kind of fixture."""


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Table, arms and fixtures. Raises `ConfigError` for fixtures that cannot stand where they are said to be."""

    table: Table = field(default_factory=Table)
    arms: tuple[ArmMount, ...] = FIRST_ALONE
    """The arms of a run with their bases and workspaces, the first arm first."""
    fixtures: tuple[Fixture, ...] = ()

    def __post_init__(self) -> None:
        check_fixtures(self.fixtures, self.table)
        for fixture, mount in itertools.product(self.fixtures, self.arms):
            if _stands_in_base(fixture, mount):
                raise ConfigError(
                    f"the fixture {fixture.name} stands in the base of the {mount.robot} arm: correct its position_m."
                )

    @cached_property
    def posts(self) -> tuple[Post, ...]:
        """The posts, in their order."""
        return tuple(one for one in self.fixtures if isinstance(one, Post))

    @cached_property
    def posts_world(self) -> Float64Array:
        """The posts (P, 8), as the rod's mechanics take them: foot x, y, z and head x, y, z of the axis [m], radius
        [m], friction. A head is rounded: its axis ends one radius below the top."""
        if not self.posts:
            return NO_POSTS
        return np.array([_post_numbers(post) for post in self.posts])

    @cached_property
    def edges_world(self) -> Float64Array:
        """Both ends (E, 2, 3) [m] of the edges of all fixtures, by which they are drawn as lines."""
        return np.concatenate([NO_EDGES, *(_edges(fixture) for fixture in self.fixtures)])


def check_fixtures(fixtures: Sequence[Fixture], table: Table) -> None:
    """Raise `ConfigError` when names are given twice, or fixtures overlap or do not stand on the table."""
    for number, fixture in enumerate(fixtures):
        if fixture.name in [other.name for other in fixtures[:number]]:
            raise ConfigError(f"two fixtures are called {fixture.name}: give one another name.")
        foot_m = fixture.position_m[2] - TABLE_TOP_M
        if abs(foot_m) > _STANDS_M:
            raise ConfigError(
                f"the fixture {fixture.name} stands {1e3 * abs(foot_m):.0f} mm {'over' if foot_m > 0 else 'below'} the "
                "table: correct the z of its position_m, which is 0 on the table."
            )
        if np.any(np.abs(fixture.corners_world[:, :2] - np.array(table.centre_m)) > np.array(table.half_size_m)):
            raise ConfigError(
                f"the fixture {fixture.name} at {np.round(fixture.position_m[:2], 3).tolist()} m stands off the table: "
                "correct its position_m, which is in metres, or the table's size_m."
            )
        if isinstance(fixture, Box) and (lowest_m := float(fixture.corners_world[:, 2].min())) < -_SUNK_M:
            raise ConfigError(
                f"the box {fixture.name} reaches {-1e3 * lowest_m:.0f} mm into the table: correct its rpy_deg; a box "
                "stands on its lower side."
            )
    for first, second in itertools.combinations(fixtures, 2):
        if _overlap(first, second):
            raise ConfigError(f"the fixtures {first.name} and {second.name} overlap: correct a position_m or a size.")


def outline_xy(fixture: Fixture) -> Float64Array:
    """Its outline seen from above (K, 2) [m], once around."""
    points = fixture.rims_world[..., :2].reshape(-1, 2)
    return points[scipy.spatial.ConvexHull(points).vertices]


def _edges(fixture: Fixture) -> Float64Array:
    """Both ends (E, 2, 3) [m] of the edges of both rims and of four edges between them."""
    rims = fixture.rims_world
    around = np.stack((rims, np.roll(rims, -1, axis=1)), axis=2).reshape(-1, 2, 3)
    upright = rims.swapaxes(0, 1)[:: rims.shape[1] // 4]
    return np.concatenate((around, upright))


def _post_numbers(post: Post) -> Float64Array:
    foot, up, radius = np.array(post.position_m), geometry.rotation(post.T_world_foot)[:, 2], post.diameter_m / 2.0
    head = foot + max(post.height_m - radius, 0.0) * up
    return np.concatenate((foot, head, [radius, post.friction]))


def _corners(T_world_foot: Pose, size_m: Sequence[float]) -> Float64Array:
    half_x, half_y = size_m[0] / 2.0, size_m[1] / 2.0
    corners = np.array(list(itertools.product((-half_x, half_x), (-half_y, half_y), (0.0, size_m[2]))))
    return geometry.transform(T_world_foot, corners)


def _overlap(first: Fixture, second: Fixture) -> bool:
    """Whether two fixtures overlap, seen from above: two that stand on one table cannot be above one another."""
    (one, one_m), (other, other_m) = _footprint(first), _footprint(second)
    return _gap_m(one, other) < one_m + other_m


def _footprint(fixture: Fixture) -> tuple[Float64Array, float]:
    """What it covers of the table: all within a distance [m] of the convex hull of points (K, 2) [m]."""
    if isinstance(fixture, Post):
        axis = _post_numbers(fixture)
        return np.array([axis[0:2], axis[3:5]]), fixture.diameter_m / 2.0
    return fixture.corners_world[:, :2], 0.0


def _gap_m(first: Float64Array, second: Float64Array) -> float:
    """Distance of the convex hulls of points (K, 2) and (L, 2) [m]; 0 or less if they overlap.

    It is the largest gap along an axis of separation: a normal of an edge, or the line between two points.
    """
    between = (first[:, None] - second).reshape(-1, 2)
    edges = np.vstack([(points[:, None] - points).reshape(-1, 2) for points in (first, second)])
    axes = np.vstack((between, edges[:, ::-1] * (1.0, -1.0)))
    lengths_m = np.linalg.norm(axes, axis=1)
    axes = (axes / np.maximum(lengths_m, _SMALLEST_M)[:, None])[lengths_m > _SMALLEST_M]
    along_m = between @ axes.T
    return float(np.maximum(along_m.min(axis=0), -along_m.max(axis=0)).max(initial=-np.inf))


def _stands_in_base(fixture: Fixture, mount: ArmMount) -> bool:
    """Whether a fixture reaches into the capsules of an arm's base, seen from above."""
    T = np.eye(4) if mount.T_world_base is None else geometry.matrix(mount.T_world_base)
    for capsule in mount.model.capsules:
        ends = np.array([capsule.start_m, capsule.end_m]) @ T[:3, :3].T + T[:3, 3]
        lowest_m = float(ends[:, 2].min()) - capsule.radius_m
        below = capsule.link == mount.model.base and lowest_m < fixture.top_m
        points, radius_m = _footprint(fixture)
        if below and _gap_m(points, ends[:, :2]) < radius_m + capsule.radius_m:
            return True
    return False


NO_FIXTURES = Scene()
"""A table and one arm without fixtures."""
