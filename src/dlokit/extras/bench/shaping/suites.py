"""The suites: lists of experiments; docs/reference/bench-shaping.md gives their reasons."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dlokit.description import shapes
from dlokit.description.dlo import SOFT_ROPE, WIRE_A, WIRE_B, WIRE_C, DloPreset
from dlokit.errors import ConfigError, ShapeError
from dlokit.extras.bench.shaping import among_posts
from dlokit.extras.bench.shaping.experiments import RAMP_M, RANDOM, BentGoal, BuiltInGoal, CurveGoal, Experiment

MOVED_BY_M = (0.06, 0.1375)
"""The goal of I to I lies 15 cm from the start, in the direction that keeps all of it in reach."""
TURNED_BY_RAD = float(np.deg2rad(40.0))
SEEDS_APART = 10_000
"""Difference between the seeds of experiments that draw their own starts and cells."""

RATIOS = (0.2, 0.4, 0.6, 0.8, 0.9, 1.0, 1.2, 1.5)
"""Elastic limit radius over goal radius."""
TURNS_DEG = (60, 120, 180)
"""Angle that each arc of the S turns by [°]."""
HELD_UP_TO = 0.9
"""Ratio up to which friction holds an S with a margin."""

SUITE_NAMES = ("paper", "goals", "stiffness", "wires", "posts", "pegs")

VERSION = 2
"""Version of the suites and of the simulated cell's settings.

It increases when a start, a goal, a DLO or a setting of the cell changes: figures of one version are comparable.
Version 2: the cell's rod no longer lengthens by 2.3 % under its own weight."""


def suite_of(name: str, goals: Path | None, *, quick: bool = False) -> tuple[Experiment, ...]:
    """The experiments of a suite, or of its quick part. Raises `ConfigError`, and `ShapeError` for a bad file."""
    if (name == "goals") != (goals is not None):
        raise ConfigError(
            "--suite goals needs a file of curves: --suite goals FILE.npy."
            if goals is None
            else f"--suite {name} takes no file ({goals}); --suite goals does."
        )
    if goals is not None:
        return goals_suite(goals)[:: 5 if quick else 1]
    if name not in _SUITES:
        raise ConfigError(f"There is no suite {name!r}; choose one of {', '.join(SUITE_NAMES)}.")
    return _SUITES[name](quick)


def fingerprint(experiments: Sequence[Experiment]) -> str:
    """Short hash of experiments: equal for equal starts, goals and DLOs, to nine digits."""
    text = re.sub(r"\d+\.\d+(e-?\d+)?", lambda number: f"{float(number[0]):.9g}", repr(tuple(experiments)))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def paper_suite() -> tuple[Experiment, ...]:
    """Section 5.3 of the paper: Fig. 7a (I to I), Fig. 7b (random to S), Fig. 8."""
    straight, bent = BuiltInGoal(name="I"), BuiltInGoal(name="S")
    moved = BuiltInGoal(name="I", moved_by_m=MOVED_BY_M, turned_by_rad=TURNED_BY_RAD)
    return (
        Experiment(name="I to S", start="I", goal=bent),
        Experiment(name="S to I", start="S", goal=straight),
        Experiment(name="I to I", start="I", goal=moved),
        Experiment(name="random to I", start=RANDOM, goal=straight),
        Experiment(name="random to S", start=RANDOM, goal=bent),
    )


def goals_suite(path: Path) -> tuple[Experiment, ...]:
    """Every curve of a file from random starts, each curve with its own starts and cells."""
    return tuple(
        Experiment(
            name=f"goal {index}",
            start=RANDOM,
            goal=CurveGoal(points_m=tuple((float(x), float(y)) for x, y in curve)),
            seed_offset=SEEDS_APART * index,
        )
        for index, curve in enumerate(read_goals(path))
    )


def read_goals(path: Path) -> np.ndarray:
    """The curves (G, K, 2) [m] of a file of (G, K, 2) or (G, K, 3). Raises `ShapeError`."""
    try:
        curves = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise ShapeError(f"Goals {path} cannot be read ({error}); give a .npy file of (G, K, 3) points [m].") from error
    if not isinstance(curves, np.ndarray) or curves.dtype.kind not in "fiu" or curves.ndim != 3:
        raise ShapeError(
            f"Goals {path} are not an array (G, K, 3) of points [m]; `dlokit shape --goal` takes one goal."
        )
    if len(curves) == 0 or curves.shape[1] < 2 or curves.shape[2] not in (2, 3):
        raise ShapeError(f"Goals {path} are {curves.shape}; (G, K, 3) or (G, K, 2) with G ≥ 1 and K ≥ 2 is required.")
    flat = curves[:, :, :2].astype(np.float64)
    for index, curve in enumerate(flat):
        if not np.all(np.isfinite(curve)) or shapes.length(curve) == 0.0:
            raise ShapeError(f"Goal {index} of {path} has no length, or points that are not numbers: correct it.")
    return flat


def stiffness_suite(ratios: tuple[float, ...] = RATIOS, turns_deg: tuple[int, ...] = TURNS_DEG) -> list[Experiment]:
    """An S of one radius for rods of rising stiffness: the elastic limit passes the radius of the goal.

    The limit is ``(EI / (μ w))^(1/3)``, the tightest arc that friction holds; μ and w are the rope's.
    """
    bend_radius_m = (SOFT_ROPE.length_m / 2.0 - RAMP_M) / np.pi  # two half circles take the whole rod
    return [
        Experiment(
            name=f"{ratio:g} of the limit, S of {turn}°",
            start=RANDOM,
            goal=BentGoal(turn_rad=float(np.deg2rad(turn)), bend_radius_m=bend_radius_m),
            groups=(f"{ratio:g} of the limit", _side(ratio)),
            dlo=rod_with_limit(ratio * bend_radius_m, f"rod_{ratio:g}"),
            told=True,
            seed_offset=SEEDS_APART * (len(turns_deg) * row + column),
        )
        for row, ratio in enumerate(ratios)
        for column, turn in enumerate(turns_deg)
    ]


def rod_with_limit(limit_m: float, name: str) -> DloPreset:
    """The rope with the stiffness that puts its elastic limit at a radius [m]."""
    stiffness = SOFT_ROPE.bending_stiffness_n_m2 * (limit_m / SOFT_ROPE.smallest_held_radius_m) ** 3
    return replace(SOFT_ROPE, name=name, bending_stiffness_n_m2=stiffness)


def _side(ratio: float) -> str:
    return f"up to {HELD_UP_TO:g} of the limit" if ratio <= HELD_UP_TO else f"above {HELD_UP_TO:g} of the limit"


def wires_suite() -> list[Experiment]:
    """The paper's experiments with each published wire, which deforms plastically; the system has no model of it."""
    return [
        replace(experiment, name=f"{wire.name}, {experiment.name}", groups=(wire.name,), dlo=wire)
        for wire in (WIRE_A, WIRE_B, WIRE_C)
        for experiment in paper_suite()
    ]


def posts_suite() -> list[Experiment]:
    """Goals among posts: four inside an S, a slalom, beside an I, and scenes that are drawn from the seed."""
    in_s, (row, around_row) = among_posts.inside_s(), among_posts.slalom()
    bent, straight = BuiltInGoal(name="S"), BuiltInGoal(name="I")
    four, one, drawn = ("four posts in an S",), ("given scenes",), ("drawn scenes",)
    return [
        Experiment(name="S, from I", start="I", goal=bent, fixtures=in_s, groups=four),
        Experiment(name="S, from random", start=RANDOM, goal=bent, fixtures=in_s, groups=four),
        Experiment(name="I, from S", start="S", goal=straight, fixtures=in_s, groups=four),
        Experiment(name="slalom", start=RANDOM, goal=around_row, fixtures=row, groups=one),
        Experiment(name="beside an I", start=RANDOM, goal=straight, fixtures=among_posts.along_i(), groups=one),
        *(
            Experiment(
                name=f"drawn scene {number}",
                start=RANDOM,
                goal=straight,
                drawn=True,
                groups=drawn,
                seed_offset=SEEDS_APART * number,
            )
            for number in (1, 2)
        ),
    ]


def pegs_suite() -> list[Experiment]:
    """Two pegs of a public board, which a longer rope winds around."""
    pegs, around = among_posts.pegs()
    rope = replace(SOFT_ROPE, name="rope_064", length_m=among_posts.PEGS_LENGTH_M)
    return [Experiment(name="two pegs", start=RANDOM, goal=around, fixtures=pegs, dlo=rope, told=True)]


def _stiffness(quick: bool) -> tuple[Experiment, ...]:
    return tuple(stiffness_suite((0.4, 0.8, 1.2), (60, 180)) if quick else stiffness_suite())


def _wires(quick: bool) -> tuple[Experiment, ...]:
    return tuple(one for one in wires_suite() if not quick or one.name.endswith(("I to S", "I to I")))


_SUITES: Mapping[str, Callable[[bool], tuple[Experiment, ...]]] = {
    "paper": lambda quick: paper_suite(),
    "stiffness": _stiffness,
    "wires": _wires,
    "posts": lambda quick: tuple(posts_suite()),
    "pegs": lambda quick: tuple(pegs_suite()),
}
