"""Every method over every case: the same clouds for all, one frame after another, timed."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

import msgspec
import numpy as np

from dlokit.bench.observers.cases import Case
from dlokit.bench.observers.clouds import Look, Looks, looks
from dlokit.bench.observers.methods import Method
from dlokit.bench.observers.metrics import Track, score
from dlokit.bench.observers.sequence import Sequence
from dlokit.skills.observer.base import ObserverStrategy, prior_from
from dlokit.types.dlo import DloState, TargetPoints
from dlokit.types.observation import Observation


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What one method did in one case with one seed."""

    case: str
    seed: int
    method: str
    frames: int
    figures: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is to be run."""

    cases: tuple[Case, ...]
    methods: tuple[Method, ...]
    seeds: int
    frames: int | None
    """Length of a sequence; None for all of an external one."""
    first_seed: int = 0

    @property
    def trials(self) -> int:
        """How many trials there will be."""
        return len(self.methods) * sum(1 if case.file else self.seeds for case in self.cases)


def run_plan(plan: Plan) -> Iterator[Trial]:
    """Every trial, seed by seed, so that what is done before an end by Ctrl-C has all cases in it."""
    for seed in range(plan.first_seed, plan.first_seed + plan.seeds):
        moved: dict[tuple[str, float], Sequence] = {}  # most cases differ in their clouds alone
        for case in plan.cases:
            if case.file is not None and seed > plan.first_seed:
                continue
            motion = (str(case.file or case.motion), case.pace)
            sequence = moved.get(motion) or case.sequence(seed, plan.frames)
            moved[motion] = sequence
            seen = looks(sequence, case.conditions, seed)
            for method in plan.methods:
                track = follow(sequence, seen, method)
                yield Trial(case=case.name, seed=seed, method=method.name, frames=len(seen), figures=dict(score(track)))


def follow(sequence: Sequence, seen: Looks | list[Look], method: Method) -> Track:
    """Track a sequence from its first frame's nodes on; each prior is the previous frame's targets."""
    topology = sequence.topology
    state = DloState(stamp_ns=seen[0].seen.stamp_ns, nodes_world=sequence.nodes_world[0].copy(), topology=topology)
    # What a first call loads or compiles is not the time of a frame.
    method.config.build().estimate(seen[0].seen, state)
    strategy = method.config.build()
    nodes, seconds = [], []
    for look in seen[1:]:
        observation = msgspec.structs.replace(look.seen, pins=look.pins) if method.pinned else look.seen
        targets, taken_s = _timed(strategy, observation, state)
        nodes.append(targets.nodes_world)
        seconds.append(taken_s)
        state = prior_from(targets, topology)
    return Track(
        nodes_world=np.array(nodes),
        true_world=sequence.nodes_world[1:],
        visible=np.array([look.visible for look in seen[1:]]),
        seconds=np.array(seconds),
    )


def _timed(strategy: ObserverStrategy, seen: Observation, state: DloState) -> tuple[TargetPoints, float]:
    # Processor time of the process: what runs beside this does not count, threads of a method do.
    began = time.process_time()
    targets = strategy.estimate(seen, state)
    return targets, time.process_time() - began
