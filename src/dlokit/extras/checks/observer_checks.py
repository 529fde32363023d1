"""The observer protocol, requirement by requirement."""

import pickle
from collections.abc import Callable, Iterator

import msgspec
import numpy as np

from dlokit.communication.wire import codec
from dlokit.errors import SkillFailure
from dlokit.extras.checks import scenes
from dlokit.extras.checks.checks import Check
from dlokit.geometry import resample, rmse_m
from dlokit.recording.message_json import from_json, to_json
from dlokit.skills.observer.base import MOST_MEMORY_BYTES, ObserverStrategy, memory_flaw, prior_from
from dlokit.types.arrays import Float64Array
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

Build = Callable[[], ObserverStrategy]
"""Builds a new instance of the observer under test."""

NOT_A_CHAIN = "not_a_chain"
"""Reason with which an observer for plain rods refuses a branched DLO."""

SHIFT_M = 0.03
"""Distance that the bow moved sideways since the previous state [m]."""
ON_ROD_M = 0.015
"""Largest mean distance that nodes may slide along the rod [m]: half of `SHIFT_M`."""


def _estimates(build: Build) -> Iterator[tuple[int, TargetPoints]]:
    """Targets for a rod that has moved, with few, the usual and many nodes."""
    for count in (10, 31, 51):
        yield count, build().estimate(scenes.cloud(0.02), scenes.before(count))


def _nodes(build: Build) -> Iterator[str]:
    for count, targets in _estimates(build):
        yield from _array("nodes_world", targets.nodes_world, (count, 3), np.float64)
        yield from _array("visible", targets.visible, (count,), np.bool_)


def _array(name: str, value: object, shape: tuple[int, ...], dtype: type[np.generic]) -> Iterator[str]:
    if not isinstance(value, np.ndarray) or value.shape != shape or value.dtype != dtype:
        found = f"{value.shape} {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__
        yield f"{name} is {found} where {shape} {np.dtype(dtype)} is wanted"
    elif dtype is np.float64 and not np.isfinite(value).all():
        yield f"{name} holds NaN or infinity"


def _order(build: Build) -> Iterator[str]:
    for which, nodes in (("first to last", scenes.rod(31)), ("last to first", scenes.rod(31)[::-1].copy())):
        found = build().estimate(scenes.cloud(0.01), scenes.before(31, nodes)).nodes_world
        nearest = np.linalg.norm(found[:, None] - nodes[None], axis=2).argmin(axis=1)
        # A node may slide past its neighbour's previous place, but not to the other side of the rod.
        if np.max(np.abs(nearest - np.arange(31))) > 5:
            yield f"with the prior's nodes {which} they come out in another order"


def _follows(build: Build) -> Iterator[str]:
    off_m = rmse_m(build().estimate(scenes.cloud(SHIFT_M), scenes.before(31)).nodes_world, scenes.rod(31, SHIFT_M))
    if not off_m < ON_ROD_M:
        yield f"a rod that moved by {SHIFT_M * 1e3:.0f} mm is found {off_m * 1e3:.1f} mm off (RMSE in the rod's order)"


def _stamp(build: Build) -> Iterator[str]:
    for what, seen in (("a cloud", scenes.cloud()), ("an empty cloud", scenes.cloud(count=0))):
        stamp_ns = build().estimate(seen, scenes.before(31)).stamp_ns
        if stamp_ns != scenes.SEEN_NS:
            yield f"targets of {what} of stamp {scenes.SEEN_NS} bear {stamp_ns}"


def _empty(build: Build) -> Iterator[str]:
    prior = scenes.before(31)
    targets = build().estimate(scenes.cloud(count=0), prior)
    if not np.array_equal(targets.nodes_world, prior.nodes_world):
        yield "the nodes are not the prior's"
    if np.any(targets.visible):
        yield f"{np.count_nonzero(targets.visible)} nodes are marked visible"
    if targets.health != 0.0:
        yield f"health is {targets.health}"


def _few_points(build: Build) -> Iterator[str]:
    for count in (1, 2, 5):
        targets = build().estimate(scenes.cloud(count=count), scenes.before(31))
        yield from _array(f"with {count} points, nodes_world", targets.nodes_world, (31, 3), np.float64)


def _hidden(build: Build) -> Iterator[str]:
    truth = scenes.rod(31, 0.015)
    targets = build().estimate(scenes.hidden_middle(0.015), scenes.before(31))
    gone = np.flatnonzero(np.abs(truth[:, 1]) < 0.03)  # their neighbours are hidden as well: two spacings are 3.3 cm
    marked = targets.visible[gone]
    if marked.any():
        yield f"nodes {gone[marked].tolist()}, at least 2 cm from any point, are marked visible"
    # Nodes dragged to the rim of the gap would be 3 cm off along the rod; nodes left at the prior, 15 mm across.
    off_m = np.sqrt(np.mean((targets.nodes_world[gone] - truth[gone]) ** 2, axis=0))
    if not off_m[1] < 0.015:
        yield f"hidden nodes are {off_m[1] * 1e3:.0f} mm off along the rod: dragged to the visible part"
    if not off_m[0] < 0.008:
        yield f"hidden nodes are {off_m[0] * 1e3:.0f} mm off across the rod: their neighbours moved, they did not"


def _seen(build: Build) -> Iterator[str]:
    visible = build().estimate(scenes.cloud(0.01), scenes.before(31)).visible
    # The last node at each end may lie past the last point.
    if not visible[1:-1].all():
        yield f"nodes {(1 + np.flatnonzero(~visible[1:-1])).tolist()} have points around them and are marked hidden"


def _outliers(build: Build) -> Iterator[str]:
    seen = scenes.cloud(0.015)
    curve = resample(scenes.rod(31, 0.015), 600)

    def off_m(observation: Observation) -> float:
        nodes = build().estimate(observation, scenes.before(31)).nodes_world
        return float(np.sqrt(np.mean(np.linalg.norm(nodes[:, None] - curve[None], axis=2).min(axis=1) ** 2)))

    pulled_m = off_m(scenes.with_strays(seen)) - off_m(seen)
    if not pulled_m < 0.004:  # the rod's radius, within the tolerance of a grasp
        yield f"10 % of stray points pull the nodes {pulled_m * 1e3:.1f} mm off the rod"


def _pure(build: Build) -> Iterator[str]:
    strategy, seen = build(), scenes.clouds_in_motion(2)[-1]
    for prior in (scenes.before(31), remembering(build)):
        first = codec.encode(strategy.estimate(seen, prior))
        strategy.estimate(scenes.cloud(-SHIFT_M), scenes.before(31))
        if codec.encode(strategy.estimate(seen, prior)) != first:
            yield (
                "the same cloud, prior and memory give other targets after another cloud: something is kept in the "
                "object, where a replay or another process does not find it"
            )
        if codec.encode(build().estimate(seen, prior)) != first:
            yield "the same cloud, prior and memory give other targets from another instance: something is random"


def remembering(build: Build) -> DloState:
    """The state that the observer leaves after the first cloud of a motion, with its memory."""
    prior = scenes.before(31)
    return prior_from(build().estimate(scenes.clouds_in_motion(1)[0], prior), prior.topology)


def _memory(build: Build) -> Iterator[str]:
    strategy, prior = build(), scenes.before(31)
    for number, seen in enumerate(scenes.clouds_in_motion(_CLOUDS), start=1):
        targets = strategy.estimate(seen, prior)
        if (flaw := memory_flaw(targets.memory)) is not None:
            yield flaw
            return
        kept = from_json(to_json(prior), DloState)  # as a recording has it
        if codec.encode(build().estimate(seen, kept)) != codec.encode(targets):
            yield f"cloud {number} gives other targets from the recorded prior and its memory in a new instance"
            return
        prior = prior_from(targets, prior.topology)
    if not prior.memory:
        return
    off_m = rmse_m(prior.nodes_world, scenes.rod(31, 0.005 * _CLOUDS))
    if not off_m < ON_ROD_M:
        yield f"after {_CLOUDS} clouds of a motion of 5 mm each the nodes are {off_m * 1e3:.1f} mm off"
    seen, first = scenes.cloud(), scenes.before(31)
    fresh = codec.encode(build().estimate(seen, first))
    others = msgspec.structs.replace(first, memory={"memory of another observer": np.zeros(3)})
    if codec.encode(build().estimate(seen, others)) != fresh:
        yield "a memory with other names, of another observer, is not ignored"


_CLOUDS = 6


def _untouched(build: Build) -> Iterator[str]:
    for seen, prior in (
        *(
            (seen, scenes.before(31))
            for seen in (scenes.cloud(0.02), scenes.cloud(count=0), scenes.hidden_middle(0.02))
        ),
        (scenes.clouds_in_motion(2)[-1], remembering(build)),
    ):
        arguments = codec.encode(seen), codec.encode(prior)
        build().estimate(seen, prior)
        if (codec.encode(seen), codec.encode(prior)) != arguments:
            yield f"a cloud of {len(seen.points_world)} points, or its prior, is changed by the call"
            return
        # Messages from the bus are read-only.
        build().estimate(codec.decode(arguments[0], Observation), codec.decode(arguments[1], DloState))


def _travels(build: Build) -> Iterator[str]:
    targets = pickle.loads(pickle.dumps(build())).estimate(scenes.cloud(0.02), scenes.before(31))
    sent = codec.decode(codec.encode(targets), TargetPoints)
    if not np.array_equal(sent.nodes_world, build().estimate(scenes.cloud(0.02), scenes.before(31)).nodes_world):
        yield "targets from a worker process differ from those of this process"


def _health(build: Build) -> Iterator[str]:
    strategy = build()
    clouds = {
        "the rod": scenes.cloud(0.01),
        "a hidden middle": scenes.hidden_middle(0.01),
        "stray points": scenes.with_strays(scenes.cloud()),
        "five points": scenes.cloud(count=5),
    }
    for what, seen in clouds.items():
        health = strategy.estimate(seen, scenes.before(31)).health
        if not 0.0 <= health <= 1.0:
            yield f"of {what} it is {health}"


def _covariance(build: Build) -> Iterator[str]:
    for seen in (scenes.cloud(0.02), scenes.hidden_middle(0.02)):
        given = build().estimate(seen, scenes.before(31)).covariance
        if given is None:
            continue
        wrong = list(_array("covariance", given, (31, 3, 3), np.float64))
        yield from wrong
        if wrong:
            return
        if not np.allclose(given, given.transpose(0, 2, 1), rtol=1e-9, atol=0.0):
            yield "covariance is not symmetric"
        if float(np.linalg.eigvalsh(given).min()) <= 0.0:
            yield "covariance is not positive definite"


def _in_view(build: Build) -> Iterator[str]:
    targets = build().estimate(scenes.in_view(scenes.cloud(), node=4), scenes.before(31))
    yield from _array("nodes_world", targets.nodes_world, (31, 3), np.float64)


def _branched(build: Build) -> Iterator[str]:
    off_m = branched_off_m(build)
    if off_m is not None and not off_m < ON_ROD_M:
        yield f"a rod with a branch that moved by 12 mm is found {off_m * 1e3:.1f} mm off"


def branched_off_m(build: Build) -> float | None:
    """RMSE on a branched DLO [m]; None where it is refused by name."""
    seen, prior, truth = scenes.branched(0.012)
    try:
        found: Float64Array = build().estimate(seen, prior).nodes_world
    except SkillFailure as failure:
        if failure.reason == NOT_A_CHAIN:
            return None
        raise
    return rmse_m(found, truth)


def _builds(build: Build) -> Iterator[str]:
    if not callable(getattr(build(), "estimate", None)):
        yield f"build() gives a {type(build()).__name__} without estimate"


BUILDS: Check[Build] = Check(
    name="builds", wanted="build() of the settings gives an object with estimate(seen, prior)", run=_builds
)
"""The requirement that is checked first."""

OBSERVER_CHECKS: tuple[Check[Build], ...] = (
    Check(
        name="nodes",
        wanted="finite float64 nodes (M, 3) [m] and bool visible (M,), with the prior's M; velocities (M, 3) or None",
        run=_nodes,
    ),
    Check(name="order", wanted="node i of the targets is node i of the prior, whichever way it runs", run=_order),
    Check(
        name="follows",
        wanted=f"nodes within {ON_ROD_M * 1e3:.0f} mm of their true places on a rod that moved by twice as much",
        run=_follows,
    ),
    Check(name="stamp", wanted="stamp_ns is the observation's", run=_stamp),
    Check(
        name="empty cloud",
        wanted="the prior's nodes, none visible, health 0: return nothing_seen(seen, prior) for no points",
        run=_empty,
    ),
    Check(name="few points", wanted="finite nodes and no exception, however few the points", run=_few_points),
    Check(
        name="hidden nodes",
        wanted="nodes without points around them are not visible and keep their place among their neighbours; "
        "dlokit.skills.observer.anchored.fill_hidden does that",
        run=_hidden,
    ),
    Check(name="seen nodes", wanted="nodes with points around them are visible", run=_seen),
    Check(name="outliers", wanted="one stray point in ten moves the nodes by less than 4 mm", run=_outliers),
    Check(
        name="pure",
        wanted="the same cloud, prior and memory give the same targets, to the bit; what lasts from cloud to cloud is "
        "returned as memory={name: array} of the targets and comes back as prior.memory; seed what is random in "
        "estimate, e.g. with the stamp",
        run=_pure,
    ),
    Check(
        name="memory",
        wanted=f"none, or named float64 arrays of at most {MOST_MEMORY_BYTES // 1024} KiB together, from which a new "
        "instance goes on to the bit; without a memory that it knows the observer begins again",
        run=_memory,
    ),
    Check(
        name="arguments untouched",
        wanted="cloud and prior stay as they are, and may be read-only: copy before you change",
        run=_untouched,
    ),
    Check(
        name="travels to a worker",
        wanted="the observer can be pickled and its targets sent: it works in another process when live",
        run=_travels,
    ),
    Check(name="health", wanted="health is a number from 0 (lost) to 1", run=_health),
    Check(
        name="covariance",
        wanted="None, or finite float64 (M, 3, 3) [m²], each symmetric and positive definite",
        run=_covariance,
    ),
    Check(
        name="camera, robot and pins",
        wanted="an observation with calibration, occlusion and a held node is no error",
        run=_in_view,
    ),
    Check(
        name="branched",
        wanted=f"a branched DLO is followed, or refused by SkillFailure({NOT_A_CHAIN!r}, …)",
        run=_branched,
    ),
)
"""The requirements on an observer; those on its settings are in `settings`."""
