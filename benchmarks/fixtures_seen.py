"""How reliably a look names fixtures that do not stand as believed, and how often it names one that does.

    python benchmarks/fixtures_seen.py --seeds 20

Each seed draws three to six posts of two sizes, a box, a rope that touches a post in every second one, and the cell
with all its errors: the camera's, ± 2 mm and ± 1° of each fixture, light, tilt. Then one thing is changed in the cell.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from rich.console import Console

from dlokit.description.arm.franka import PANDA
from dlokit.description.clearance import clear_of
from dlokit.description.installation import Installation
from dlokit.description.scene import Box, Fixture, Post
from dlokit.extras.bench.report import BenchFigure, figure
from dlokit.extras.bench.statistics import success_rate
from dlokit.functional.cell.config import EVERY_FACTOR, CellConfig
from dlokit.functional.cell.world import Cell
from dlokit.motion.forward_kinematics import PosedArm
from dlokit.skills.perception.config import PerceptionConfig
from dlokit.skills.perception.fixture_check import check_fixtures
from dlokit.skills.perception.pipeline import corrected_camera_pose
from dlokit.types.arrays import Float64Array
from dlokit.types.fixtures import ACCEPTED, FixtureCheck, FixtureSight
from dlokit.types.image import CameraPictures
from parts.command import check_json, run_study, seeds_of, write_figures

CASES = ("as believed", "moved by 15 mm", "exchanged", "missing", "unknown", "one alone", "one alone, moved")
CAMERAS = {"stereo": 1, "d435": 6}
"""Pictures of each camera for one look."""
SIZES_M = ((0.010, 0.025), (0.014, 0.040))
"""Diameter and height of the posts [m]."""
APART_M = 0.07
AREA_M = ((0.33, 0.68), (-0.28, 0.28))
CONFIG = PerceptionConfig()


@dataclass(frozen=True, kw_only=True)
class Args:
    """Look at changed scenes, and count what is named."""

    seeds: int = 20
    """Scenes of each case, with seeds from `first_seed` on."""
    first_seed: int = 500
    """First seed."""
    higher_m: float = 0.015
    """How much higher and, by a quarter of this, thicker the posts of the second size are [m]."""
    json: Path | None = None
    """Write the figures to this file."""


def run(args: Args) -> int:
    """Measure and print; exit code 0."""
    seeds = seeds_of(args.seeds, args.first_seed)
    check_json(args.json)
    console = Console(highlight=False, soft_wrap=True)
    rows: list[BenchFigure] = []
    for case in CASES:
        results = {seed: looks(case, seed, args.higher_m) for seed in seeds}
        for method in results[args.first_seed]:
            of_method = {seed: result[method] for seed, result in results.items()}
            named, missed, false, hidden = np.array(list(of_method.values())).sum(axis=0)
            wrong = [seed for seed, counts in of_method.items() if counts[1] or counts[2]]
            console.print(
                f"{case:16}  {method:24} named {named}, missed {missed} of {args.seeds}; {false} false alarms; "
                f"{hidden} fixtures not seen{f'; seeds {wrong}' if wrong else ''}"
            )
            rows.append(figure(case, method, "missed", success_rate(int(missed), args.seeds), "1"))
            noisy = sum(counts[2] > 0 for counts in of_method.values())
            rows.append(figure(case, method, "with a false alarm", success_rate(noisy, args.seeds), "1"))
    write_figures(args.json, "fixtures seen", rows, {"seeds": args.seeds, "first_seed": args.first_seed}, console)
    return 0


def looks(case: str, seed: int, higher_m: float) -> dict[str, tuple[int, int, int, int]]:
    """For each camera, with a pose corrected by table or hand, the result of `judged`."""
    rng = np.random.default_rng([seed, 0xF1])
    fixtures = drawn(rng, 1 if case.startswith("one alone") else int(rng.integers(3, 7)), higher_m)
    believed, true, changed = change(case, fixtures, rng)
    config = CellConfig(randomised=EVERY_FACTOR, fixtures=true, settle_s=0.0)
    cell = Cell(config, seed=seed, installation=Installation(fixtures=believed))
    cell.place_dlo(rope(fixtures, true, rng, touching=bool(seed % 2)), settle=False)
    robots = (PosedArm(PANDA, cell.arm_state()),)
    pictures: dict[str, list[CameraPictures]] = {"stereo": [cell.capture()], "d435": []}
    pictures["d435"] = [cell.capture_depth() for _ in range(CAMERAS["d435"])]
    calibrations = {"stereo": cell.rig.true_calibration, "d435": cell.depth_rig.true_calibration}
    cell.close()
    result: dict[str, tuple[int, int, int, int]] = {}
    for camera, taken in pictures.items():
        by_table = corrected_camera_pose(taken[0], robots, CONFIG, CONFIG.segmentation)
        for pose, T in (("table", by_table), ("hand", calibrations[camera].T_world_camera)):
            assert T is not None, "the cell's table has texture"
            placed = [
                msgspec.structs.replace(one, calibration=msgspec.structs.replace(one.calibration, T_world_camera=T))
                for one in taken
            ]
            check = check_fixtures(placed, robots, CONFIG, CONFIG.segmentation, believed, pose_known=pose == "hand")
            result[f"{camera}, pose by the {pose}"] = judged(check, changed)
    return result


def drawn(rng: np.random.Generator, posts: int, higher_m: float) -> tuple[Fixture, ...]:
    """Posts of two sizes, and with more than one a box, apart from one another."""
    fixtures: list[Fixture] = []
    while len(fixtures) < posts + (posts > 1):
        x, y = (float(rng.uniform(*span)) for span in AREA_M)
        if any(np.hypot(x - one.position_m[0], y - one.position_m[1]) < APART_M for one in fixtures):
            continue
        name, place = f"F{len(fixtures)}", (x, y, 0.0)
        if len(fixtures) == posts:
            turn = (0.0, 0.0, float(rng.uniform(0.0, 180.0)))
            fixtures.append(Box(name=name, position_m=place, rpy_deg=turn, size_m=(0.03, 0.05, 0.04)))
            continue
        more = higher_m if len(fixtures) % 2 else 0.0
        fixtures.append(Post(name=name, position_m=place, diameter_m=0.010 + more / 4.0, height_m=0.025 + more))
    return tuple(fixtures)


def change(
    case: str, fixtures: tuple[Fixture, ...], rng: np.random.Generator
) -> tuple[tuple[Fixture, ...], tuple[Fixture, ...], set[str]]:
    """Believed and true fixtures of a case, and the names that a look should report; "" is an unknown thing."""
    first, rest = fixtures[0], fixtures[1:]
    match case:
        case "moved by 15 mm" | "one alone, moved":
            angle = rng.uniform(0.0, 2.0 * np.pi)
            x, y, _ = first.position_m
            place = (x + 0.015 * float(np.cos(angle)), y + 0.015 * float(np.sin(angle)), 0.0)
            return fixtures, (replace(first, position_m=place), *rest), {first.name}
        case "exchanged":
            second = rest[0]
            pair = replace(first, position_m=second.position_m), replace(second, position_m=first.position_m)
            return fixtures, (*pair, *rest[1:]), {first.name, second.name}
        case "missing":
            return fixtures, rest, {first.name}
        case "unknown":
            return rest, fixtures, {""}
        case _:
            return fixtures, fixtures, set()


def rope(
    fixtures: Sequence[Fixture], true: Sequence[Fixture], rng: np.random.Generator, *, touching: bool
) -> Float64Array:
    """A straight rope (2, 3) [m] beside the first post, or away from all fixtures."""
    far = np.array([[0.85, -0.25, 0.004], [0.85, 0.25, 0.004]])
    post = fixtures[0]
    assert isinstance(post, Post), "the first fixtures are posts"
    for angle in rng.uniform(0.0, 2.0 * np.pi, 100 if touching else 0):
        along, across = np.array([np.cos(angle), np.sin(angle), 0.0]), np.array([-np.sin(angle), np.cos(angle), 0.0])
        middle = np.array([*post.position_m[:2], 0.004]) + (post.diameter_m / 2.0 + 0.007) * across
        line = middle + np.array([[-0.25], [0.25]]) * along
        on_table = np.all((line[:, :2] > (0.2, -0.4)) & (line[:, :2] < (0.9, 0.4)))
        if on_table and clear_of(line, fixtures[1:], 0.015) and clear_of(line, true, 0.005):
            return line
    return far


def judged(check: FixtureCheck, changed: set[str]) -> tuple[int, int, int, int]:
    """Whether what was changed is named; whether it is seen and not named; other things named; fixtures not seen."""
    named = Counter(one.name for one in check.findings if one.sight not in ACCEPTED)
    hidden = {one.name for one in check.findings if one.sight is FixtureSight.NOT_SEEN}
    is_named = bool(changed & named.keys())  # of two exchanged fixtures one is enough: no arm moves
    others = sum(count for name, count in named.items() if name not in changed)
    return int(is_named), int(bool(changed - hidden) and not is_named), others, len(hidden)


if __name__ == "__main__":
    run_study(Args, run, __doc__)
