"""Compares what stands on the table with the fixtures that are believed to stand there.

The surface is computed in the whole picture; what is higher than a DLO on the table, in the box, and neither robot nor
DLO, forms patches of pixels. A patch is compared with the picture that the believed fixture would give in the same
camera and of which the same is hidden, so that errors of the method, which widens and blurs small things, cancel.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from dlokit.description.scene import Fixture
from dlokit.description.table import TABLE_TOP_M
from dlokit.geometry import rotation
from dlokit.geometry.camera import back_project, baseline_m, project, rays
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.base import SegmentationConfig
from dlokit.skills.perception.cloud import inside_box
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.fixture_filter import fixture_depth_m
from dlokit.skills.perception.pipeline import cleaned, segmented
from dlokit.skills.perception.rectification import grey, rectified
from dlokit.skills.perception.self_filter import PICTURE_MARGIN_M, robot_capsules, robot_outline
from dlokit.skills.perception.stereo import StereoMatcher
from dlokit.types.arrays import BoolArray, Float64Array, Int64Array
from dlokit.types.fixtures import FixtureCheck, FixtureFinding, FixtureSight
from dlokit.types.image import CameraCalibration, CameraPictures, DepthImage, StereoImages

_LOW_M = 0.010
"""What is lower is table or DLO [m]: above a rope of 8 mm, and five times the noise of six depth pictures."""
_LOWEST_M = 0.015
"""A thing with a lower top cannot be told from the table [m]."""
_LEAST_M2 = 40e-6
"""A smaller patch is noise [m²]: a post of 8 x 20 mm has 90 mm² above `_LOW_M`."""
_TOP_PERCENT = 90
"""Percentile of the heights in a patch that counts as its height."""
_WIDER_PX = {StereoImages: 3, DepthImage: 7}
"""Side of the window in which the nearest surface wins [px]: matching widens what is in front, DLO and fixtures."""
_FARTHER_M = 0.002
"""A patch is seen this much too far from the camera, along the table [m]: the foot of a thing is lost in the table."""
_NEAR_PX = 7
"""Side of the window by which a fixture's expected pixels are widened to find its patches [px]: the camera's error."""
_ROBOT_PX = 9
"""Side of the window by which the robot is widened [px]: matching mixes its surface with what is beside it."""
_LONG = 6.0
"""A segmented patch longer than this many times its width is a DLO's; a shorter one may be a bright fixture."""
_LARGEST_BLIND = 0.4
"""A patch of whose surroundings a larger fraction is unknown is no thing: beside an arm stereo matching finds heights
at random, and mostly none."""
_SHOWN = 0.45
"""A fixture of which a smaller fraction can be seen is not judged."""
_FARTHEST_M = 0.06
"""A patch farther away than this is another thing, not the fixture that was moved [m]."""
_CAMERA_M = 0.012
"""A larger common shift of all fixtures is theirs, not the camera's [m]."""
_LEAST_FIXTURES = 3
"""Fixtures that are needed to find a common shift: of two, one may have moved."""
_OFF_M, _OFF_ALONE_M = 0.0075, 0.0095
"""A fixture farther than this from its believed place has moved [m]. The belief is right to 3 mm, the turn of a camera
adds 2 and the method 2; with neither a common shift nor a check by the hand, the camera's shift of 4 comes too."""
_SIGMA_M = np.array([0.002, 0.004])
"""Standard deviation of the width and the height of a patch [m]."""
_OTHER_SIZE = 4.0
"""A fixture whose width and height differ from the believed ones by more than this many standard deviations."""
_TOLD_APART = 3.0
"""Two fixtures whose believed sizes differ by this many standard deviations are told apart."""
_REVERSED = -0.3
"""Ratio of the seen to the believed difference of two sizes: 1 as believed, -1 exchanged, which a smaller one means."""


@dataclass(frozen=True, kw_only=True)
class _Patch:
    """One thing that stands on the table, as seen or as expected."""

    place_world: Float64Array  # (2,) where the line of sight to its middle meets the table [m]
    size_m: Float64Array  # (2,) width across the line of sight, height [m]


@dataclass(frozen=True, kw_only=True)
class _Match:
    """How a believed fixture is seen, less how it was expected to be."""

    offset_m: Float64Array  # (2,)
    larger_m: Float64Array  # (2,) width, height
    expected: _Patch


def check_fixtures(
    pictures: Sequence[CameraPictures],
    robots: Sequence[PosedArm],
    config: PerceptionConfig,
    segmentation: SegmentationConfig,
    fixtures: Sequence[Fixture],
    *,
    pose_known: bool,
) -> FixtureCheck:
    """Compare the believed fixtures with pictures of one moment: several of a depth camera, whose mean is used.

    `pose_known`: the hand has corrected the camera's pose, so that a common shift of the fixtures is their own.
    """
    ideal = [rectified(each) for each in pictures]
    camera, wider_px = ideal[0].calibration, _WIDER_PX[type(ideal[0])]
    surface = _surface(ideal, config)  # (height, width, 3)
    robot = robot_outline(robot_capsules(robots), camera, PICTURE_MARGIN_M)
    blind = ~np.isfinite(surface[..., 2]) | _widened(robot, _ROBOT_PX)
    hidden = blind | _widened(_dlo(ideal[0], config, segmentation), wider_px)
    inside = inside_box(surface.reshape(-1, 3), config.box).reshape(hidden.shape)
    heights_m = [_expected_m(fixture, camera, wider_px) for fixture in fixtures]
    owners = _owners(inside & (surface[..., 2] > TABLE_TOP_M + _LOW_M) & ~hidden, [z > _LOW_M for z in heights_m])
    seen = _patches({owner: owners == owner for owner in np.unique(owners[owners >= 0])}, surface[..., 2], camera)
    expected: dict[int, _Patch] = {}
    for number, (fixture, height_m) in enumerate(zip(fixtures, heights_m, strict=True)):
        if _can_be_seen(fixture, height_m > _LOW_M, hidden, camera, config):
            expected |= _patches({number: (height_m > _LOW_M) & ~hidden}, height_m, camera)
    matches, unknown = _matched(seen, expected, len(fixtures), camera)
    matches, common_m = _without_common(matches, pose_known)
    limit_m = _OFF_M if pose_known or common_m.any() else _OFF_ALONE_M
    exchanged = _exchanged(matches)
    findings: list[FixtureFinding] = []
    for number, fixture in enumerate(fixtures):
        match = matches.get(number)
        findings.append(
            FixtureFinding(
                name=fixture.name,
                sight=_sight(match, limit_m, number in exchanged) if number in expected else FixtureSight.NOT_SEEN,
                place_world=np.array(fixture.position_m[:2]) + (0.0 if match is None else match.offset_m),
                offset_m=np.zeros(2) if match is None else match.offset_m,
                larger_m=np.zeros(2) if match is None else match.larger_m,
            )
        )
    for thing in unknown:
        around = _widened(owners == thing, _ROBOT_PX) & (owners != thing)
        if seen[thing].size_m[1] >= _LOWEST_M and np.mean(blind[around]) <= _LARGEST_BLIND:
            findings.append(_unknown(seen[thing], camera, wider_px))
    return FixtureCheck(stamp_ns=pictures[0].stamp_ns, findings=tuple(findings), camera_offset_m=common_m)


def _surface(pictures: Sequence[CameraPictures], config: PerceptionConfig) -> Float64Array:
    """The surface in each pixel (height, width, 3) [m] of rectified pictures; NaN where it is unknown."""
    first, camera = pictures[0], pictures[0].calibration
    if isinstance(first, StereoImages):
        disparity = StereoMatcher(config.stereo).match_all(grey(first.left), grey(first.right), camera).pixels
        known = disparity > 0.0
        depth_m = camera.fx_px * baseline_m(camera) / np.where(known, disparity, 1.0)
    else:
        depths_m = np.array([each.depth_m for each in pictures if isinstance(each, DepthImage)], dtype=np.float64)
        counts = np.count_nonzero(depths_m > 0.0, axis=0)
        known = 2 * counts >= len(depths_m)
        depth_m = depths_m.sum(axis=0) / np.maximum(counts, 1)
    return back_project(_pixels(camera), np.where(known, depth_m, np.nan).ravel(), camera).reshape(*known.shape, 3)


def _pixels(camera: CameraCalibration) -> Float64Array:
    """All pixels (height * width, 2), row by row."""
    v, u = np.mgrid[0 : camera.height_px, 0 : camera.width_px]
    return np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)


def _dlo(picture: CameraPictures, config: PerceptionConfig, segmentation: SegmentationConfig) -> BoolArray:
    """The pixels (height, width) that show the DLO: the long ones of the segmented patches."""
    mask = cleaned(segmented(picture.reference, segmentation.build()), config.smallest_patch_px)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    patch_of = np.asarray(labels, dtype=np.int64)
    widths_px = np.zeros(count)
    inner_px = np.asarray(cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, 3))
    np.maximum.at(widths_px, patch_of.ravel(), 2.0 * inner_px.ravel())
    is_long = np.asarray(stats)[:, cv2.CC_STAT_AREA] >= _LONG * widths_px**2
    return mask & is_long[patch_of]


def _widened(mask: BoolArray, side_px: int) -> BoolArray:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((side_px, side_px), np.uint8))) > 0


def _expected_m(fixture: Fixture, camera: CameraCalibration, wider_px: int) -> Float64Array:
    """Height (height, width) [m] over the table in the picture of a fixture alone on it, widened as by matching."""
    climb = (rays(_pixels(camera), camera) @ rotation(camera.T_world_camera)[2]).reshape(camera.height_px, -1)
    eye_m = float(camera.T_world_camera.position_m[2]) - TABLE_TOP_M
    table_m = np.where(climb < 0.0, -eye_m / np.minimum(climb, -1e-9), np.inf)
    depth_m = np.minimum(fixture_depth_m(fixture, camera), table_m).astype(np.float32)
    nearest_m = np.asarray(cv2.erode(depth_m, np.ones((wider_px, wider_px), np.uint8)), dtype=np.float64)
    return np.where(np.isfinite(nearest_m), eye_m + np.minimum(nearest_m, 1e9) * climb, 0.0)


def _owners(standing: BoolArray, masks: Sequence[BoolArray]) -> Int64Array:
    """The number of the fixture, or of an unknown thing, in each pixel (height, width); -1 where nothing stands.

    A connected patch is the fixture's into whose mask it reaches; one that reaches into several is divided.
    """
    count, labels = cv2.connectedComponents(standing.astype(np.uint8), connectivity=8)
    owners: Int64Array = np.where(standing, np.asarray(labels, dtype=np.int64) - 1 + len(masks), -1)
    reached = [np.unique(owners[_widened(mask, _NEAR_PX)]) for mask in masks]
    for thing in range(len(masks), len(masks) + count - 1):
        if claims := [number for number, things in enumerate(reached) if thing in things]:
            rows, columns = np.nonzero(owners == thing)
            middles = np.array([np.mean(np.nonzero(masks[number]), axis=1) for number in claims])
            nearest = np.hypot(rows[:, None] - middles[:, 0], columns[:, None] - middles[:, 1]).argmin(axis=1)
            owners[rows, columns] = np.array(claims)[nearest]
    return owners


def _patches(masks: Mapping[int, BoolArray], heights_m: Float64Array, camera: CameraCalibration) -> dict[int, _Patch]:
    """The things in masks (height, width) of pixels, by number, without those that are too small."""
    patches: dict[int, _Patch] = {}
    R, eye = rotation(camera.T_world_camera), camera.T_world_camera.position_m
    for number, mask in masks.items():
        v, u = np.nonzero(mask)
        if len(u) == 0:
            continue
        ray = R @ rays([[u.mean(), v.mean()]], camera)[0]
        depth_m = float((TABLE_TOP_M - eye[2]) / ray[2])
        pixel_m = depth_m / camera.fx_px
        if len(u) * pixel_m**2 < _LEAST_M2:
            continue
        width_m = np.sqrt(12.0) * float(np.std(u)) * pixel_m  # of a rectangle that spreads as much
        height_m = float(np.percentile(heights_m[mask], _TOP_PERCENT))
        patches[number] = _Patch(place_world=(eye + depth_m * ray)[:2], size_m=np.array([width_m, height_m]))
    return patches


def _can_be_seen(
    fixture: Fixture, mask: BoolArray, hidden: BoolArray, camera: CameraCalibration, config: PerceptionConfig
) -> bool:
    """Whether a fixture is high enough, in the picture and the box, and not hidden, to be judged."""
    pixels = project(fixture.corners_world, camera).pixels
    in_picture = np.all((pixels >= 0.0) & (pixels <= [camera.width_px - 1, camera.height_px - 1]))
    in_box = np.all(inside_box(fixture.corners_world, config.box))
    shown = np.count_nonzero(mask & ~hidden) >= _SHOWN * np.count_nonzero(mask)
    return bool(fixture.top_m >= _LOWEST_M and in_picture and in_box and shown)


def _matched(
    seen: Mapping[int, _Patch], expected: Mapping[int, _Patch], count: int, camera: CameraCalibration
) -> tuple[dict[int, _Match], list[int]]:
    """The fixtures that are seen, each with its own patch or the nearest unknown one; the other unknown things."""
    pairs = {number: number for number in expected if number in seen}
    unknown = [thing for thing in seen if thing >= count]
    for number in expected:
        if number not in pairs and unknown:
            far_m = [float(np.linalg.norm(seen[t].place_world - expected[number].place_world)) for t in unknown]
            if min(far_m) <= _FARTHEST_M:
                pairs[number] = unknown.pop(int(np.argmin(far_m)))
    matches: dict[int, _Match] = {}
    for number, thing in pairs.items():
        away = expected[number].place_world - camera.T_world_camera.position_m[:2]
        offset_m = seen[thing].place_world - expected[number].place_world
        offset_m -= _FARTHER_M * away / max(float(np.linalg.norm(away)), _FARTHER_M)
        larger_m = seen[thing].size_m - expected[number].size_m
        matches[number] = _Match(offset_m=offset_m, larger_m=larger_m, expected=expected[number])
    return matches, unknown


def _without_common(matches: dict[int, _Match], pose_known: bool) -> tuple[dict[int, _Match], Float64Array]:
    """Matches without what most of them share, and their common shift (2,) [m].

    A shift is the camera's error; a wrong size is the method's, whose bias depends on the light.
    """
    if len(matches) < _LEAST_FIXTURES:
        return matches, np.zeros(2)
    common_m: Float64Array = np.median([match.offset_m for match in matches.values()], axis=0)
    if pose_known or np.linalg.norm(common_m) > _CAMERA_M:
        common_m = np.zeros(2)
    bias_m = np.median([match.larger_m for match in matches.values()], axis=0)
    less = {
        number: replace(match, offset_m=match.offset_m - common_m, larger_m=match.larger_m - bias_m)
        for number, match in matches.items()
    }
    return less, common_m


def _exchanged(matches: Mapping[int, _Match]) -> set[int]:
    """The fixtures of pairs whose sizes differ as they should, but the other way round."""
    reversals: list[tuple[float, int, int]] = []
    for (i, first), (j, second) in itertools.combinations(matches.items(), 2):
        believed = (first.expected.size_m - second.expected.size_m) / _SIGMA_M
        seen = believed + (first.larger_m - second.larger_m) / _SIGMA_M
        if np.linalg.norm(believed) >= _TOLD_APART:
            reversals.append((float(believed @ seen) / float(believed @ believed), i, j))
    found: set[int] = set()
    for ratio, i, j in sorted(reversals):
        if ratio < _REVERSED and not found & {i, j}:
            found |= {i, j}
    return found


def _sight(match: _Match | None, limit_m: float, exchanged: bool) -> FixtureSight:
    """How a fixture that can be seen is seen."""
    if match is None:
        return FixtureSight.MISSING
    if np.linalg.norm(match.offset_m) > limit_m:
        return FixtureSight.MOVED
    other = exchanged or bool(np.linalg.norm(match.larger_m / _SIGMA_M) > _OTHER_SIZE)
    return FixtureSight.OTHER_SIZE if other else FixtureSight.AS_BELIEVED


def _unknown(patch: _Patch, camera: CameraCalibration, wider_px: int) -> FixtureFinding:
    """The finding on an unknown thing, whose middle is above the table and thus nearer to the camera."""
    away = np.append(patch.place_world, TABLE_TOP_M) - camera.T_world_camera.position_m
    wider_m = (wider_px - 1) * float(np.linalg.norm(away)) / camera.fx_px
    place = patch.place_world + 0.5 * patch.size_m[1] / away[2] * away[:2]
    size_m = patch.size_m - [wider_m, 0.0]
    return FixtureFinding(name="", sight=FixtureSight.UNKNOWN, place_world=place, offset_m=np.zeros(2), larger_m=size_m)
