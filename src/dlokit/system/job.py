"""Resolves the task of a run: start and goal by name, from a file, drawn at random, or set by the operator."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from dlokit import geometry
from dlokit.decision.journal import Journal
from dlokit.decision.records import GoalRequest
from dlokit.description import shapes
from dlokit.description.passing import passing
from dlokit.description.point_files import is_file_name, read_points
from dlokit.description.scene import Fixture
from dlokit.description.shapes import LENGTH_TOLERANCE
from dlokit.description.table import TABLE_X_M, TABLE_Y_M
from dlokit.errors import ShapeError
from dlokit.functional.cell.drawn_cell import installed_fixtures
from dlokit.system.config import BY_OPERATOR, SEEN, RunConfig
from dlokit.system.other_hosts import other_hosts
from dlokit.system.results.run_folder import HIDDEN_START
from dlokit.types.arrays import Float64Array, as_numbers
from dlokit.types.flow import OperatorCommand
from dlokit.types.passing import AsWished

RANDOM = "random"
MAX_LIFT_M = 0.05
"""Maximum height above the table of a shape that counts as being on it [m]."""
_SAMPLES = (", ".join((*shapes.BUILTIN_SHAPES, RANDOM)), "a .npy or .csv file with (K, 3) or (K, 2) points in metres")


@dataclass(frozen=True, kw_only=True)
class ShapeJob:
    """The task, with start and goal resolved to points."""

    name: str
    """Display name, e.g. ``"I to S"``."""
    start_nodes_world: Float64Array  # (K, 3) [m] known only to the cell
    request: GoalRequest | None
    """None: the operator sets the goal in the viewer."""
    shown: bool = False
    """Whether the shape that the camera sees first is the goal."""
    stays: bool = False
    """Whether the run takes another goal from the viewer after each task, until the operator ends it."""
    start: OperatorCommand | None = None
    """The operator's start command, when it arrived before this task was made."""
    takes_over: bool = False
    """Whether an earlier task was stopped: its fingers may still hold the DLO, which is then put down first."""
    resumed: Journal | None = None
    """Journal of the run that this one resumes."""


def job_from_config(config: RunConfig) -> ShapeJob:
    """Read, draw or look up start and goal shapes. Raises `ShapeError`.

    The start has the length of the cell's DLO, the goal the length of the system's model. Without a cell there is no
    start: the system observes the real DLO.
    """
    name, start = f"to {Path(config.goal).name}", HIDDEN_START
    if config.has_cell:
        name = f"{Path(config.start).name} {name}"
        start = _shape(
            config,
            config.start,
            config.cell.dlo.length_m,
            config.cell.dlo.radius_m,
            stream=0,
            fixtures=installed_fixtures(config.cell, config.installation),
        )
    if config.goal in BY_OPERATOR:
        return ShapeJob(name=name, start_nodes_world=start, request=None, shown=config.goal == SEEN)
    model = config.model
    goal = _shape(
        config,
        config.goal,
        model.length_m,
        model.radius_m,
        stream=1,
        fixtures=config.installation.fixtures,
        middle_m=config.goal_at_m,
        # A goal outside the table is rejected at once, unless it is to be moved or tried there.
        on_table=config.task.infeasible == "reject",
    )
    _require_sides(config, goal)
    request = GoalRequest(nodes_world=goal, name=config.goal, ends_interchangeable=config.ends_interchangeable)
    return ShapeJob(name=name, start_nodes_world=start, request=request)


def _require_sides(config: RunConfig, goal_world: Float64Array) -> None:
    """Refuse a goal (K, 3) [m] that passes a post otherwise than wished by more than the threshold."""
    ends, far_m = config.ends_interchangeable, config.task.threshold_m
    found = passing(goal_world, config.installation.fixtures, config.wish, ends_interchangeable=ends, unsure_m=far_m)
    if wrong := [one.why for one in found.answers if one.answer is AsWished.NO]:
        contradicted = f"--beside {config.beside!r} contradicts the goal {config.goal}"
        raise ShapeError(f"{contradicted}, which {', '.join(wrong)}: correct one of them.")


def with_absolute_files(config: RunConfig) -> RunConfig:
    """Replace file names by absolute paths, so that the configuration is valid in every folder."""
    elsewhere = other_hosts(config)
    hosts = None if elsewhere is None else elsewhere.absolute()
    calibration = str(Path(config.calibration).expanduser().absolute()) if config.calibration else ""
    return replace(
        config, start=_absolute(config.start), goal=_absolute(config.goal), calibration=calibration, hosts=hosts
    )


def _absolute(text: str) -> str:
    return str(Path(text).expanduser().absolute()) if is_file_name(text) else text


def _shape(
    config: RunConfig,
    text: str,
    length_m: float,
    radius_m: float,
    *,
    stream: int,
    fixtures: Sequence[Fixture],
    middle_m: tuple[float, float] | None = None,
    on_table: bool = True,
) -> Float64Array:
    # Start and goal use separate random streams, so that one does not change the other.
    rng = np.random.default_rng([config.seed, stream])
    return shape_from_text(
        text,
        length_m=length_m,
        count=shapes.CURVE_POINTS,
        radius_m=radius_m,
        rng=rng,
        fixtures=fixtures,
        fit_length=config.fit_length,
        middle_m=middle_m,
        on_table=on_table,
    )


def named_or_saved(shape: str | Path | ArrayLike, name: str, folder: Path) -> str:
    """A shape as a configuration names it, by name or file; points are saved in `folder`. Raises `BadValue`."""
    if isinstance(shape, str | Path):
        return str(shape)
    path = (folder / f"{name}.npy").absolute()
    np.save(path, as_numbers(shape, name))
    return str(path)


def shape_from_text(
    text: str,
    *,
    length_m: float,
    count: int,
    radius_m: float,
    rng: np.random.Generator,
    fixtures: Sequence[Fixture] = (),
    fit_length: bool = False,
    middle_m: tuple[float, float] | None = None,
    on_table: bool = True,
) -> Float64Array:
    """The shape that the user names, for a rope of `length_m` and `radius_m`.

    Without `on_table` it may be anywhere. `middle_m` is the position on the table (x, y) [m] to which the centre of the
    shape's extent is moved, if given. `rng` and `fixtures` are used only for ``random`` shapes, which are clear of
    them. Returns nodes (count, 3) [m] in the world frame, equally spaced by arc length, with exactly the length of the
    rope. Raises `ShapeError`.
    """
    name = text.strip()
    if name in shapes.BUILTIN_SHAPES:
        nodes = shapes.builtin_shape(name, length_m, count, radius_m=radius_m)
    elif name == RANDOM:
        nodes = shapes.random_shape(rng, length_m, count, radius_m=radius_m, fixtures=fixtures)
    else:
        if not is_file_name(name):
            raise _unknown(name, Path(name).expanduser())
        points = _on_rope_height(read_points(name), name, radius_m)
        nodes = _of_rope_length(points, name, length_m, count, fit_length=fit_length)
    if middle_m is not None:
        extent = (nodes[:, :2].min(axis=0) + nodes[:, :2].max(axis=0)) / 2.0
        nodes = shapes.moved(nodes, np.asarray(middle_m) - extent)
    if on_table:
        _require_on_table(nodes, name)
    return nodes


def _unknown(text: str, path: Path) -> ShapeError:
    allowed = f"Allowed are {_SAMPLES[0]}, or {_SAMPLES[1]}"
    for name in (*shapes.BUILTIN_SHAPES, RANDOM):
        if text.lower() == name.lower():
            return ShapeError(f"There is no shape {text!r}; did you mean {name!r}? {allowed}.")
    if path.suffix and path.is_file():
        return ShapeError(f"Shape file {path} ends in {path.suffix!r}. {allowed}: convert it to one of them.")
    return ShapeError(f"There is no shape {text!r}. {allowed}.")


def _on_rope_height(points: Float64Array, text: str, radius_m: float) -> Float64Array:
    """Points (K, 2) or (K, 3) as (K, 3); planar points get the height of a rope on the table."""
    if points.shape[1] == 2:
        return np.column_stack([points, np.full(len(points), radius_m)])
    if points[:, 2].min() < -MAX_LIFT_M or points[:, 2].max() > MAX_LIFT_M:
        raise ShapeError(
            f"Shape {text} has heights z from {points[:, 2].min():.3f} to {points[:, 2].max():.3f} m; the rope lies "
            f"on the table at z = {radius_m} m and {MAX_LIFT_M} m is allowed. Correct z, or give (K, 2) points."
        )
    # A rope on the table has one height; deviations within the tolerance are measurement errors of the file.
    return np.column_stack([points[:, :2], np.full(len(points), radius_m)])


def _of_rope_length(points: Float64Array, text: str, length_m: float, count: int, *, fit_length: bool) -> Float64Array:
    """Resample points (K, 3) to nodes (count, 3) with the length of the rope."""
    arc_m = shapes.length(points)
    if arc_m == 0.0:
        raise ShapeError(f"Shape {text} has zero length in the table plane: its points are above one another.")
    if abs(arc_m - length_m) > LENGTH_TOLERANCE * length_m and not fit_length:
        raise ShapeError(
            f"Shape {text} is {arc_m:.3f} m long, the rope {length_m:.3f} m; a difference of {LENGTH_TOLERANCE:.0%} is "
            "allowed. Give a curve of the rope's length, or scale it: setting fit_length (--fit-length)."
        )
    return geometry.resample(shapes.fit_length(points, length_m), count)


def _require_on_table(nodes: Float64Array, text: str) -> None:
    (x0, x1), (y0, y1) = TABLE_X_M, TABLE_Y_M
    x, y = nodes[:, 0], nodes[:, 1]
    if x.min() < x0 or x.max() > x1 or y.min() < y0 or y.max() > y1:
        raise ShapeError(
            f"Shape {text} is outside the table: it spans x {x.min():.3f} to {x.max():.3f} m and y {y.min():.3f} to "
            f"{y.max():.3f} m (world frame, on the table); allowed are x {x0} to {x1} m and y {y0} to {y1} m. "
            "Move it there; a goal is moved by setting goal_at_m (--goal-at-m 0.52 0), or to the nearest place by "
            "task.infeasible (--infeasible project)."
        )
