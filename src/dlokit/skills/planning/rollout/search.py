"""The search: simulates candidates of every family, refines the promising ones, and tests the best on other rods."""

import itertools
import math
import os
from collections.abc import Awaitable, Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Annotated, TypeVar

import numpy as np
from msgspec import Meta

from dlokit.communication.port import Compute
from dlokit.description.scene import NO_POSTS
from dlokit.errors import ConfigError
from dlokit.ranges import Count, Positive, check_ranges
from dlokit.rod.believed import BeliefConfig, BelievedDlo
from dlokit.rod.rollout import UNCERTAINTY, Motion, PlanningRod, RolloutResult, rods_around, simulate
from dlokit.skills.planning.rollout.candidates import Candidate, Family
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array

T = TypeVar("T")

_LEAST = 16  # rollouts in addition to those of the finalists


_OTHER_RODS = 8  # on which each finalist is tested: the number of `uncertain_rods`


@dataclass(frozen=True, kw_only=True)
class SearchConfig:
    """Number of simulated actions per decision."""

    rollouts: Count = 480
    """Largest number of simulated motions per decision. Larger: better actions, and longer decisions."""
    seconds: Positive = 2.0
    """Time for one decision when live [s]: the search ends with what it has then. Larger: better actions on a slow
    machine. If less than a quarter of the rollouts fits, it takes up to three times as long. Ignored in lockstep."""
    generations: Annotated[int, Meta(ge=0)] = 8
    """Rounds in which the best candidates are refined. Larger: more refinement, of fewer candidates each."""
    finalists: Count = 8
    """Number of best candidates that are tested on eight other rods: stiffer, softer, rougher and smoother. Larger:
    actions that depend less on the model's parameters, and fewer candidates."""

    def __post_init__(self) -> None:
        check_ranges(self, "planning.strategy.search")
        finals = self.finalists * _OTHER_RODS
        if self.rollouts < _LEAST + finals:
            raise ConfigError(
                f"--planning.strategy.search.rollouts is {self.rollouts}; it must be {_LEAST + finals} or greater: "
                f"{self.finalists} finalists take {finals}, and {_LEAST} more are needed."
            )


_LARGEST_BATCH = 8  # rollouts per core between two readings of the clock
_BATCH_FRACTION = 0.05  # of the time: the longest batch
_FINALS_FRACTION = 0.3  # of the time: the most that is reserved for the finals
_PATIENCE = 3.0  # times the time: the longest decision, on a busy machine


class Timer:
    """The time limit of a decision, which is divided among its phases. Without a stopwatch there is no limit.

    On a machine so busy that fewer than `least` rollouts fit, the limit is extended, up to three times: a poor action
    costs the robot more than the wait.
    """

    def __init__(
        self, seconds: float, stopwatch: Callable[[], float] | None, cores: int = 0, *, least: int = 0
    ) -> None:
        """`cores` simulate at the same time; 0: all of this machine."""
        self._asked_s, self._least, self._stopwatch = seconds, least, stopwatch
        self._cores = cores or len(os.sched_getaffinity(0))
        self._began_s = stopwatch() if stopwatch is not None else 0.0
        self._simulated, self._simulating_s = 0, 0.0
        self._until = 1.0  # fraction of the time
        self._kept_s = 0.0

    @contextmanager
    def simulating(self, rollouts: int) -> Generator[None]:
        """Note the number of rollouts that the block simulates."""
        began_s = self._passed_s()
        yield
        self._simulated += rollouts
        self._simulating_s += self._passed_s() - began_s

    def allow(self, fraction: float, finalists: int, each: int) -> None:
        """From now on, allow this fraction of the time, less the time for finalists of `each` rollouts.

        Reserves no time for the finals if a single round would exceed the finals' fraction of the time.
        """
        part_s, most_s = each * self._cores * self._each_s(), _FINALS_FRACTION * self._seconds
        kept_s = min(math.ceil(finalists / self._cores) * part_s, most_s) if part_s <= most_s else 0.0
        self._until, self._kept_s = fraction, kept_s

    def too_short_for(self, rollouts: int) -> bool:
        """Whether this number of rollouts would take longer than the configured time at the present speed."""
        return self._stopwatch is not None and rollouts * self._each_s() > self._asked_s

    @property
    def over(self) -> bool:
        """Whether the allowed time has passed; at least one block is always simulated."""
        return (
            self._stopwatch is not None
            and self._simulated > 0
            and self._passed_s() >= self._until * (self._seconds - self._kept_s)
        )

    def batch(self, count: int) -> int:
        """Number of the `count` rollouts to simulate before the clock is read again; a few until the speed is known."""
        if self._stopwatch is None:
            return count
        if self._simulated == 0:
            return min(count, self._cores)
        rounds = int(_BATCH_FRACTION * self._seconds / max(self._cores * self._each_s(), 1e-9))
        return min(count, self._cores * min(max(rounds, 1), _LARGEST_BATCH))

    def rounds(self, items: Sequence[T], each: int) -> Iterator[Sequence[T]]:
        """The items, which take `each` rollouts, in parts, until the next part would exceed the time limit."""
        size = len(items) if self._stopwatch is None else self._cores
        for start in range(0, len(items), max(1, size)):
            ends_s = self._passed_s() + each * self._cores * self._each_s()
            if self._stopwatch is not None and ends_s > self._seconds:
                return
            yield items[start : start + size]

    @property
    def _seconds(self) -> float:
        """The time limit of the decision, with its extension on a busy machine [s]."""
        if self._simulated == 0:
            return self._asked_s
        needed_s = self._least * self._passed_s() / self._simulated
        return min(max(self._asked_s, needed_s), _PATIENCE * self._asked_s)

    def _passed_s(self) -> float:
        return 0.0 if self._stopwatch is None else self._stopwatch() - self._began_s

    def _each_s(self) -> float:
        """Mean time per rollout so far, with all cores in use [s]."""
        return self._simulating_s / self._simulated if self._simulated else 0.0


_TRIES = 3  # vectors of numbers drawn per candidate, because some are not feasible
_ELITE = 6  # candidates of a family that are refined
_WORTH_IT = 1.6  # a family is refined while its best score is at most this times the best of all
_AT_ONCE = 2  # families refined in one generation
_NARROWER = 0.75  # ratio of the spreads of two successive generations
_SHOWN = 6  # reported candidates
_TIMESTEP_S = 0.01  # of the planning rod
_BESIDE_M = 0.003  # distance of the other rods from the observed position
_LEAST_FRACTION = 0.25  # minimum fraction of the rollouts in a live decision, even after its time limit


def uncertain_rods(sure: BeliefConfig) -> tuple[PlanningRod, ...]:
    """Rods with other parameters than the model's, as far as these are uncertain by `sure`.

    All combinations of higher and lower friction and stiffness, with the shape displaced to either side.
    """
    friction_by, stiffness_by = (
        max(UNCERTAINTY, math.exp(log_sd)) for log_sd in (sure.friction_log_sd, sure.stiffness_log_sd)
    )
    rods = list[PlanningRod]()
    for k, rod in enumerate(rods_around(friction_by, stiffness_by)):
        x, y = _BESIDE_M * math.cos(k * math.pi / 4.0), _BESIDE_M * math.sin(k * math.pi / 4.0)
        rods += [replace(rod, shift_m=(x, y)), replace(rod, shift_m=(-x, -y))]
    return tuple(rods)


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """A candidate with its score and the shape (M, 3) [m] expected after it."""

    candidate: Candidate
    score_m: float
    nodes_world: Float64Array


@dataclass(frozen=True, kw_only=True)
class Scoring:
    """How candidates are scored; smaller is better."""

    score: Callable[[RolloutResult, Sequence[type[Action]]], Float64Array]
    """Scores (R, C) [m] of the results of C motions of these kinds on R rods."""
    judge: Callable[[Float64Array], Float64Array]
    """One score (C,) [m] per motion from its scores on all rods."""
    least_m: Callable[[type[Action]], float] = lambda kind: 0.0
    """Lower bound on the score of any action of the kind [m]."""


async def _ignore(rollouts: int, best: Sequence[Choice]) -> None:
    """Ignores everything."""


@dataclass(frozen=True, kw_only=True)
class SearchWatch:
    """The observer of a search, and the clock that ends it."""

    tell: Callable[[int, Sequence[Choice]], Awaitable[None]] = _ignore
    """Called in every generation with the number of rollouts and the best choices."""
    stopwatch: Callable[[], float] | None = None
    """The machine's time [s]; None: only rollouts are limited."""


@dataclass
class _Pool:
    """A family and its simulated candidates."""

    family: Family
    choices: list[Choice] = field(default_factory=list[Choice])

    def best(self, count: int) -> list[Choice]:
        return sorted(self.choices, key=_score)[:count]


class Search:
    """One decision: distributes the rollouts over generations."""

    def __init__(
        self,
        nodes_world: Float64Array,
        model: BelievedDlo,
        config: SearchConfig,
        scoring: Scoring,
        compute: Compute,
        watch: SearchWatch | None = None,
        threads: int = 0,
        *,
        posts: Float64Array = NO_POSTS,
    ) -> None:
        """Uses `threads` threads, 0: one per core. The result does not depend on it. `posts` (P, 8) of the scene."""
        self._nodes, self._model, self._config, self._posts = nodes_world, model, config, posts
        self._scoring, self._compute = scoring, compute
        self._rods = uncertain_rods(model.belief)
        self._watch = watch or SearchWatch()
        self._timer = Timer(
            config.seconds, self._watch.stopwatch, threads, least=round(_LEAST_FRACTION * config.rollouts)
        )
        self._threads = threads
        self.spent = 0
        """Rollouts so far."""

    async def run(self, families: Sequence[Family], rng: np.random.Generator) -> list[Choice]:
        """Choices, the best first.

        The kind with the lowest bound is simulated first; under a time limit, a kind whose bound is above the best
        score so far is skipped, and its rollouts are saved.
        """
        config, least_m = self._config, self._scoring.least_m
        each = len(self._rods)
        budget = config.rollouts - config.finalists * each
        pools = [_Pool(family) for family in sorted(families, key=lambda family: least_m(family.kind))]
        fraction = max(1, budget // (2 * len(pools)))
        found_m = math.inf
        for k, pool in enumerate(pools):
            if self._timer.too_short_for(config.rollouts) and least_m(pool.family.kind) >= found_m:
                budget -= fraction * (len(pools) - k)  # more rollouts of the same candidates would only favour chance
                break
            self._timer.allow(0.5 * (k + 1) / len(pools), config.finalists, each)
            await self._try(pool, pool.family.first(_TRIES * fraction, rng), fraction)
            found_m = min([found_m, *(choice.score_m for choice in pool.choices)])
            await self._tell(pools)
        pools = [pool for pool in pools if pool.choices]
        if not pools:
            return []
        for generation in range(config.generations):
            self._timer.allow(0.5 + 0.5 * (generation + 1) / config.generations, config.finalists, each)
            if self._timer.over:
                continue
            left = (budget - self.spent) // (config.generations - generation)
            promising = self._promising(pools)
            for pool in promising:
                count = max(1, left // len(promising))
                spread = pool.family.spread * _NARROWER**generation
                await self._try(pool, _around(pool, spread, _TRIES * count, rng), count)
            await self._tell(pools)
        finalists, others = _mixed(pools, config.finalists)
        return [*await self._finals(finalists), *others]

    def _promising(self, pools: list[_Pool]) -> list[_Pool]:
        ranked = sorted(pools, key=lambda pool: pool.best(1)[0].score_m)
        return [
            pool for pool in ranked[:_AT_ONCE] if pool.best(1)[0].score_m <= _WORTH_IT * ranked[0].best(1)[0].score_m
        ]

    async def _try(self, pool: _Pool, numbers: Sequence[Float64Array], count: int) -> None:
        """Simulate the first `count` of these parameters that give a candidate, or as many as time allows."""
        rest, left = iter(numbers), count
        # Candidates are made only when simulated: checking the arm's reach takes as long as a short rollout.
        while left > 0 and not self._timer.over:
            made = _made(pool.family, rest, self._timer.batch(left))
            if not made:
                return
            await self._simulate_once(pool, made)
            left -= len(made)

    async def _simulate_once(self, pool: _Pool, made: Sequence[Candidate]) -> None:
        """Simulate candidates with the model's rod."""
        simulated = await self._simulate(made, (PlanningRod(),))
        for candidate, score, nodes in zip(
            made,
            self._scoring.score(simulated, [pool.family.kind] * len(made))[0],
            simulated.nodes_world[0],
            strict=True,
        ):
            pool.choices.append(Choice(candidate=candidate, score_m=float(score), nodes_world=nodes))

    async def _tell(self, pools: list[_Pool]) -> None:
        """The best of each kind and node: refinements of one candidate differ too little to be distinguished."""
        best = dict[tuple[type[Action], int], Choice]()
        for choice in sorted((choice for pool in pools for choice in pool.choices), key=_score):
            best.setdefault((choice.candidate.kind, choice.candidate.motion.node), choice)
        await self._watch.tell(self.spent, tuple(best.values())[:_SHOWN])

    async def _finals(self, finalists: list[Choice]) -> list[Choice]:
        """The finalists in the order of their score on all rods; those omitted for lack of time are last."""
        rods = self._rods
        if not finalists or not rods:
            return finalists
        judged = list[float]()
        for some in self._timer.rounds(finalists, len(rods)):
            simulated = await self._simulate([choice.candidate for choice in some], rods)
            expected = np.array([[choice.score_m for choice in some]])
            kinds = [choice.candidate.kind for choice in some]
            judged += self._scoring.judge(np.concatenate((expected, self._scoring.score(simulated, kinds)))).tolist()
        return [*(finalists[k] for k in np.argsort(judged, kind="stable")), *finalists[len(judged) :]]

    async def _simulate(self, candidates: Sequence[Candidate], rods: tuple[PlanningRod, ...]) -> RolloutResult:
        motions: tuple[Motion, ...] = tuple(candidate.motion for candidate in candidates)
        self.spent += len(motions) * len(rods)
        with self._timer.simulating(len(motions) * len(rods)):
            return await self._compute(
                simulate, self._model, self._nodes, rods, motions, _TIMESTEP_S, self._threads, posts=self._posts
            )


def _made(family: Family, numbers: Iterator[Float64Array], count: int) -> list[Candidate]:
    """The next `count` candidates; fewer when the parameters are exhausted."""
    candidates = (candidate for candidate in map(family.make, numbers) if candidate is not None)
    return list(itertools.islice(candidates, count))


def _mixed(pools: list[_Pool], count: int) -> tuple[list[Choice], list[Choice]]:
    """The best `count` of all, at most half from one pool if there are others, as similar candidates fail together;
    and the rest, the best first."""
    half = max(1, count // 2) if len(pools) > 1 else count
    seeded = [choice for pool in pools for choice in pool.best(half)]
    ranked = sorted(seeded, key=_score)
    found = ranked[:count]
    rest = [choice for pool in pools for choice in pool.choices if choice not in found]
    return found, sorted(rest, key=_score)


def _score(choice: Choice) -> float:
    return choice.score_m


def _around(pool: _Pool, spread: Float64Array, count: int, rng: np.random.Generator) -> list[Float64Array]:
    """Parameters of `count` children: each parent corrected; then variations of it."""
    parents = pool.best(_ELITE)
    aimed = [pool.family.aimed(parent.candidate.numbers, parent.nodes_world) for parent in parents]
    more = (rng.integers(len(aimed), size=max(0, count - len(aimed)))).tolist()
    return [*aimed, *(aimed[k] + spread * rng.standard_normal(len(spread)) for k in more)]
