"""The evaluator: the true error of a run, from the cell's hidden truth, after the run. It alone reads `truth.npz`.

It reports the distance to the same goal as the system does, 2 s after each release. The system cannot distinguish the
ends of the rope, and orders the nodes of its first look by its own rule. The evaluator therefore chooses the order of
the truth that is nearer to the system's first estimate, and keeps it: if the system confuses the ends later, its error
grows.
"""

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from dlokit import geometry
from dlokit.description.passing import passing
from dlokit.description.scene import Fixture
from dlokit.errors import InputError
from dlokit.functional.cell.truth import TRUTH_FILE, read_forces, read_rows
from dlokit.system.results.run_result import FixtureContact, RunRecord, RunResult
from dlokit.types.arrays import Float64Array, Int64Array, RowArray
from dlokit.types.passing import SideWish


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The true shapes of the DLO during a run, and the forces between arms and fixtures."""

    stamps_ns: Int64Array  # (T,) rising, on the cell's clock [ns]
    nodes_world: Float64Array  # (T, Mc, 3) [m], Mc nodes of the cell's own rod
    fixture_forces: RowArray | None = None
    """The largest force for each link and fixture that have touched; None without fixtures."""

    def at(self, stamp_ns: int) -> Float64Array:
        """Nodes (Mc, 3) [m] at a time, interpolated between two records; constant outside of them."""
        last = len(self.stamps_ns) - 1
        after = int(np.clip(np.searchsorted(self.stamps_ns, stamp_ns), min(1, last), last))
        before = max(after - 1, 0)
        span = float(self.stamps_ns[after] - self.stamps_ns[before])
        part = 0.0 if span == 0.0 else float(np.clip((stamp_ns - self.stamps_ns[before]) / span, 0.0, 1.0))
        return (1.0 - part) * self.nodes_world[before] + part * self.nodes_world[after]


def _arrays(folder: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any], RowArray | None]:
    """Stamps, nodes and forces that the cell wrote: `truth.npz`, or the rows of a cell that was killed."""
    if not (folder / TRUTH_FILE).exists():
        return *read_rows(folder), read_forces(folder)
    with np.load(folder / TRUTH_FILE, allow_pickle=False) as arrays:
        forces = np.asarray(arrays["fixture_forces"]) if "fixture_forces" in arrays else None
        return np.asarray(arrays["stamps_ns"]), np.asarray(arrays["nodes_world"]), forces


def read_truth(folder: Path) -> Truth:
    """Read the truth in a run's folder, also of a killed cell. Raises `InputError` when it is missing or invalid."""
    path = folder / TRUTH_FILE
    try:
        stamps, nodes, forces = _arrays(folder)
    except FileNotFoundError:
        raise InputError(f"{folder} holds no {TRUTH_FILE}: only runs on the simulated cell write it.") from None
    except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path} is not a cell's truth ({error}): run it again.") from error
    if stamps.ndim != 1 or len(stamps) == 0 or nodes.ndim != 3 or nodes.shape[::2] != (len(stamps), 3):
        raise InputError(
            f"{path} holds stamps_ns {stamps.shape} and nodes_world {nodes.shape}; expected (T,) and (T, Mc, 3) "
            "with T of at least 1: run it again."
        )
    return Truth(stamps_ns=stamps.astype(np.int64), nodes_world=nodes.astype(np.float64), fixture_forces=forces)


SETTLE_S = 2.0
"""A released rope is judged this long after the release [s]."""
_GRACE_NS = 100_000_000
"""A record may end 0.1 s early [ns]: 1.9 s after the release a rope moves by micrometres."""


@dataclass(frozen=True, kw_only=True)
class TrueErrors:
    """True errors of a run."""

    after_action_m: tuple[float | None, ...]
    """Error 2 s after each release [m]; None for an action without a release, or if the truth does not cover it."""
    final_m: float | None
    """Error 2 s after the last release, or at the end of the record when nothing was released [m]."""
    final_largest_m: float | None
    """Largest distance of a node from its goal node at that time [m]."""
    reversed_order: bool
    """Whether the system counts the nodes from the other end than the cell."""
    final_nodes_world: Float64Array | None = None  # (Mc, 3) [m]
    """The DLO at that time, from the end from which the system counts; None if the truth does not cover it."""


def evaluate(record: RunRecord, truth: Truth) -> TrueErrors:
    """The true errors of a run. Raises `InputError` when record and truth are not of the same run."""
    if record.start_nodes_world is None:
        # The DLO was never seen: without an order of the system the nearer one is fair.
        goal = record.goal_nodes_world
        nodes = geometry.resample(truth.nodes_world[-1], len(goal))
        rmse_m, largest_m = _errors(nodes, goal, ends_interchangeable=True)
        return TrueErrors(
            after_action_m=(),
            final_m=rmse_m,
            final_largest_m=largest_m,
            reversed_order=False,
            final_nodes_world=truth.nodes_world[-1],
        )
    return true_errors(
        truth,
        goal_nodes_world=record.goal_nodes_world,
        first_nodes_world=record.start_nodes_world,
        first_stamp_ns=record.start_stamp_ns,
        release_stamps_ns=[action.release_stamp_ns for action in record.actions],
        ends_interchangeable=record.ends_interchangeable,
    )


def true_errors(
    truth: Truth,
    *,
    goal_nodes_world: Float64Array,
    first_nodes_world: Float64Array,
    first_stamp_ns: int,
    release_stamps_ns: Sequence[int | None],
    ends_interchangeable: bool = False,
) -> TrueErrors:
    """The true errors to a goal (M, 3) [m], in the order that fits the system's first estimate (M, 3) [m] best.

    `release_stamps_ns` are on the cell's clock [ns], one an action, None for an action without a release.
    Raises `InputError` when a stamp lies before the truth begins.
    """
    count = len(goal_nodes_world)
    at_first = geometry.resample(_covered(truth, first_stamp_ns), len(first_nodes_world))
    forward = geometry.rmse_m(at_first, first_nodes_world)
    reversed_order = geometry.rmse_m(at_first[::-1], first_nodes_world) < forward

    def errors_at(stamp_ns: int) -> tuple[float, float] | tuple[None, None]:
        if stamp_ns > truth.stamps_ns[-1] + _GRACE_NS:
            return None, None
        nodes = geometry.resample(_covered(truth, stamp_ns), count)
        ordered = nodes[::-1] if reversed_order else nodes
        return _errors(ordered, goal_nodes_world, ends_interchangeable=ends_interchangeable)

    settle_ns = round(SETTLE_S * 1e9)
    after = tuple(None if stamp is None else errors_at(stamp + settle_ns)[0] for stamp in release_stamps_ns)
    releases = [stamp for stamp in release_stamps_ns if stamp is not None]
    final_stamp_ns = max(releases) + settle_ns if releases else int(truth.stamps_ns[-1])
    final_m, final_largest_m = errors_at(final_stamp_ns)
    final = None if final_m is None else _covered(truth, final_stamp_ns)
    return TrueErrors(
        after_action_m=after,
        final_m=final_m,
        final_largest_m=final_largest_m,
        reversed_order=reversed_order,
        final_nodes_world=final[::-1] if final is not None and reversed_order else final,
    )


def _errors(nodes: Float64Array, goal: Float64Array, *, ends_interchangeable: bool) -> tuple[float, float]:
    """RMSE and largest distance [m] of nodes (M, 3) to goal nodes (M, 3) [m]; the nearer order if both are allowed."""
    orders = [nodes, nodes[::-1]] if ends_interchangeable else [nodes]
    nearer = min(orders, key=lambda ordered: geometry.rmse_m(ordered, goal))
    return geometry.rmse_m(nearer, goal), float(np.linalg.norm(nearer - goal, axis=1).max())


def with_truth(result: RunResult, errors: TrueErrors) -> RunResult:
    """A result with the evaluator's figures filled in. Raises `InputError` when the numbers of actions differ."""
    if len(errors.after_action_m) != len(result.history):
        raise InputError(
            f"The result has {len(result.history)} actions, the record {len(errors.after_action_m)}: "
            "they are not of the same run."
        )
    history = tuple(
        msgspec.structs.replace(row, true_rmse_m=error)
        for row, error in zip(result.history, errors.after_action_m, strict=True)
    )
    return msgspec.structs.replace(
        result, history=history, true_rmse_m=errors.final_m, true_largest_m=errors.final_largest_m
    )


def with_true_passing(
    result: RunResult, errors: TrueErrors, fixtures: Sequence[Fixture], *, ends_interchangeable: bool
) -> RunResult:
    """A result with how the true DLO passes the true fixtures; of the wish, what names posts that stand there."""
    if result.passing is None or errors.final_nodes_world is None:
        return result
    names = {one.name for one in fixtures}
    wish = [SideWish(name=one.name, turn=one.turn) for one in result.passing.answers if one.name in names]
    true = passing(errors.final_nodes_world, fixtures, wish, ends_interchangeable=ends_interchangeable, unsure_m=0.0)
    return msgspec.structs.replace(result, true_passing=true)


def with_forces(result: RunResult, truth: Truth) -> RunResult:
    """A result with the largest force between an arm and a fixture; unchanged without fixtures."""
    if (forces := truth.fixture_forces) is None:
        return result
    if len(forces) == 0:
        return msgspec.structs.replace(result, largest_fixture_force_n=0.0)
    link, fixture, force_n, stamp_ns = forces[np.argmax(forces["force_n"])].item()
    contact = FixtureContact(link=link, fixture=fixture, stamp_ns=stamp_ns)
    return msgspec.structs.replace(result, largest_fixture_force_n=force_n, fixture_contact=contact)


def _covered(truth: Truth, stamp_ns: int) -> Float64Array:
    """The truth (Mc, 3) [m] at a time. Raises `InputError` before its beginning."""
    if stamp_ns < truth.stamps_ns[0] - _GRACE_NS:
        raise InputError(
            f"The truth begins at {truth.stamps_ns[0] * 1e-9:.3f} s, after {stamp_ns * 1e-9:.3f} s: the files are "
            "not of the same run, or the cell began to record too late."
        )
    return np.asarray(truth.at(stamp_ns))


def left_nodes_world(folder: Path) -> Float64Array:
    """Last shape (Mc, 3) [m] of the DLO of the cell that ran in `folder`; only the next cell may read it.

    Raises `InputError` if no cell has written a truth.
    """
    path = folder / TRUTH_FILE
    try:
        return np.array(_arrays(folder)[1][-1], dtype=np.float64)
    except (OSError, KeyError, ValueError, IndexError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path} does not show where the cell left its DLO ({error}): start again with dlokit shape --config "
            f"{folder / 'config.toml'}"
        ) from error
