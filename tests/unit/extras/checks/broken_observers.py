"""A valid observer, and one for each requirement that violates little else."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import msgspec
import numpy as np

from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy
from dlokit.skills.observer.cpd import CpdConfig
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation

Tweak = Callable[[Observation, DloState, TargetPoints], TargetPoints]
change = msgspec.structs.replace


def not_at_all(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return targets


def single_precision(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, nodes_world=targets.nodes_world.astype(np.float32))


def in_the_order_of_y(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    if len(seen.points_world) == 0:
        return targets
    return change(targets, nodes_world=targets.nodes_world[np.argsort(targets.nodes_world[:, 1])])


def stays(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, nodes_world=prior.nodes_world.copy())


def stamp_of_the_prior(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, stamp_ns=prior.stamp_ns)


def confident_of_nothing(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, health=1.0) if len(seen.points_world) == 0 else targets


def wants_many_points(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    if 0 < len(seen.points_world) < 10:
        raise ValueError("too few points")
    return targets


def sees_all(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return targets if len(seen.points_world) == 0 else change(targets, visible=np.ones_like(targets.visible))


def sees_none(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, visible=np.zeros_like(targets.visible))


def drawn_to_strays(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    points, nodes = seen.points_world.astype(np.float64), targets.nodes_world
    if len(points) == 0:
        return targets
    off = np.linalg.norm(points[:, None] - nodes[None], axis=2).min(axis=1)
    return change(targets, nodes_world=nodes + 0.2 * (points[np.argmax(off)] - nodes))


def random(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    noise = np.random.default_rng().normal(0.0, 1e-9, targets.nodes_world.shape)
    return targets if len(seen.points_world) == 0 else change(targets, nodes_world=targets.nodes_world + noise)


def overwrites(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    if prior.nodes_world.flags.writeable and len(seen.points_world) > 0:
        prior.nodes_world[:] = targets.nodes_world
    return targets


def over_healthy(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return targets if len(seen.points_world) == 0 else change(targets, health=float("nan"))


def flat_covariance(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    flat = np.tile(np.diag([1e-6, 1e-6, 0.0]), (len(targets.nodes_world), 1, 1))
    return change(targets, covariance=flat)


def without_camera(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    assert seen.calibration is None, "no camera was expected"
    return targets


def without_branches(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    if not np.array_equal(prior.topology.edges[:, 0], np.arange(len(prior.topology.edges))):
        raise IndexError("edges are not in a row")
    return targets


def keeps_whole_numbers(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return change(targets, memory={"clouds": np.array([1])})


def tied_to_its_process(seen: Observation, prior: DloState, targets: TargetPoints) -> TargetPoints:
    return targets


BROKEN: dict[str, Tweak] = {
    "nodes": single_precision,
    "order": in_the_order_of_y,
    "follows": stays,
    "stamp": stamp_of_the_prior,
    "empty cloud": confident_of_nothing,
    "few points": wants_many_points,
    "hidden nodes": sees_all,
    "seen nodes": sees_none,
    "outliers": drawn_to_strays,
    "pure": random,
    "memory": keeps_whole_numbers,
    "arguments untouched": overwrites,
    "travels to a worker": tied_to_its_process,
    "health": over_healthy,
    "covariance": flat_covariance,
    "camera, robot and pins": without_camera,
    "branched": without_branches,
}
"""Violation of each requirement, by its name."""


@dataclass(frozen=True)
class BrokenConfig:
    """An observer that is valid except for one requirement."""

    name: ClassVar[str] = "broken"

    breaks: str = ""
    """The requirement that it violates; empty: none."""

    def build(self, dlo: BelievedDlo) -> ObserverStrategy:
        return Broken(BROKEN.get(self.breaks, not_at_all))


class Broken:
    def __init__(self, tweak: Tweak) -> None:
        self._sound = CpdConfig().build(BelievedDlo())
        self._tweak = tweak
        self._tie = (lambda: None) if tweak is tied_to_its_process else None  # a lambda cannot be pickled

    def estimate(self, seen: Observation, prior: DloState) -> TargetPoints:
        return self._tweak(seen, prior, self._sound.estimate(seen, prior))
