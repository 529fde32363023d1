"""The search: candidates of every family, the promising ones refined, the best tried on rods that the DLO may be."""

import itertools
import math
from collections.abc import Awaitable, Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from dlokit.communication.port import Compute
from dlokit.skills.model.config import BeliefConfig, ModelConfig
from dlokit.skills.model.quick_rollout import Motion, Played, QuickRod, play
from dlokit.skills.planning.rollouts.candidates import Candidate, Family
from dlokit.skills.planning.rollouts.config import SearchConfig
from dlokit.skills.planning.rollouts.timer import Timer
from dlokit.types.action import Action
from dlokit.types.arrays import Float64Array

_TRIES = 3  # as many numbers are drawn for a candidate that can be done
_ELITE = 6  # candidates of a family that are refined
_WORTH_IT = 1.6  # a family is refined while its best is no worse than this times the best of all
_AT_ONCE = 2  # families refined in one generation
_NARROWER = 0.75  # spread of a generation against the one before
_SHOWN = 6  # candidates that are told of
_LEAST_SHARE = 0.25  # of the rollouts, that a live decision waits for though its time has passed


def doubtful_rods(config: SearchConfig, sure: BeliefConfig) -> tuple[QuickRod, ...]:
    """What the DLO may be like besides what the model says, which is as `sure` of it."""
    if config.doubt == 1.0:
        return ()
    friction_by, stiffness_by = (
        max(config.doubt, math.exp(log_sd)) for log_sd in (sure.friction_log_sd, sure.stiffness_log_sd)
    )
    rods = list[QuickRod]()
    both = itertools.product((1.0 / friction_by, friction_by), (1.0 / stiffness_by, stiffness_by))
    for k, (friction, stiffness) in enumerate(both):
        x, y = config.astray_m * math.cos(k * math.pi / 4.0), config.astray_m * math.sin(k * math.pi / 4.0)
        for shift_m in ((x, y), (-x, -y)):
            rods.append(QuickRod(friction_share=friction, stiffness_share=stiffness, shift_m=shift_m))
    return tuple(rods)


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """A candidate with its score and the shape (M, 3) [m] expected after it."""

    candidate: Candidate
    score_m: float
    nodes_world: Float64Array


@dataclass(frozen=True, kw_only=True)
class Scoring:
    """What candidates are compared by; less is better."""

    score: Callable[[Played, Sequence[type[Action]]], Float64Array]
    """(R, C) [m] of what C motions of these kinds did to R rods."""
    judge: Callable[[Float64Array], Float64Array]
    """(C,) [m] of that."""
    least_m: Callable[[type[Action]], float] = lambda kind: 0.0
    """What no action of the kind can score below [m], however well it is aimed."""


async def _tell_nobody(rollouts: int, best: Sequence[Choice]) -> None:
    """Nobody watches."""


@dataclass(frozen=True, kw_only=True)
class Watch:
    """Who is told of a search, and by what clock it ends."""

    tell: Callable[[int, Sequence[Choice]], Awaitable[None]] = _tell_nobody
    """Told of the rollouts spent and the best choices, every generation."""
    stopwatch: Callable[[], float] | None = None
    """The machine's time [s]; None: rollouts alone are counted."""


@dataclass
class _Pool:
    """A family and what was tried of it."""

    family: Family
    choices: list[Choice] = field(default_factory=list[Choice])

    def best(self, count: int) -> list[Choice]:
        return sorted(self.choices, key=_score)[:count]


class Search:
    """One decision: rollouts are spent generation by generation."""

    def __init__(
        self,
        nodes_world: Float64Array,
        model: ModelConfig,
        config: SearchConfig,
        scoring: Scoring,
        compute: Compute,
        watch: Watch | None = None,
    ) -> None:
        self._nodes, self._model, self._config = nodes_world, model, config
        self._scoring, self._compute = scoring, compute
        self._rods = doubtful_rods(config, model.belief)
        self._watch = watch or Watch()
        self._timer = Timer(
            config.seconds, self._watch.stopwatch, config.threads, least=round(_LEAST_SHARE * config.rollouts)
        )
        self.spent = 0
        """Rollouts so far."""

    async def run(self, families: Sequence[Family], rng: np.random.Generator) -> list[Choice]:
        """Choices, the best first.

        The kind that can score best is played first; where time is short, one that cannot score as well as what was
        found is not played, and its share of the rollouts is saved.
        """
        config, least_m = self._config, self._scoring.least_m
        each = len(self._rods)
        budget = config.rollouts - config.finalists * each
        pools = [_Pool(family) for family in sorted(families, key=lambda family: least_m(family.kind))]
        share = max(1, budget // (2 * len(pools)))
        found_m = math.inf
        for k, pool in enumerate(pools):
            if self._timer.too_short_for(config.rollouts) and least_m(pool.family.kind) >= found_m:
                budget -= share * (len(pools) - k)  # more of what is played already would only find what flatters it
                break
            self._timer.allow(0.5 * (k + 1) / len(pools), config.finalists, each)
            await self._try(pool, pool.family.first(_TRIES * share, rng), share)
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
        """Play the first `count` of these numbers that make a candidate, or as many as time allows."""
        rest, left = iter(numbers), count
        # What is not played is not made either: the arm's reach takes as long to find out as a short rollout.
        while left > 0 and not self._timer.over:
            made = _made(pool.family, rest, self._timer.batch(left))
            if not made:
                return
            await self._play_once(pool, made)
            left -= len(made)

    async def _play_once(self, pool: _Pool, made: Sequence[Candidate]) -> None:
        """Play candidates on the rod that the model has."""
        played = await self._play(made, (QuickRod(),))
        for candidate, score, nodes in zip(
            made, self._scoring.score(played, [pool.family.kind] * len(made))[0], played.nodes_world[0], strict=True
        ):
            pool.choices.append(Choice(candidate=candidate, score_m=float(score), nodes_world=nodes))

    async def _tell(self, pools: list[_Pool]) -> None:
        """The best of each kind and node: all of one refined differ by less than anybody can see."""
        best = dict[tuple[type[Action], int], Choice]()
        for choice in sorted((choice for pool in pools for choice in pool.choices), key=_score):
            best.setdefault((choice.candidate.kind, choice.candidate.motion.node), choice)
        await self._watch.tell(self.spent, tuple(best.values())[:_SHOWN])

    async def _finals(self, finalists: list[Choice]) -> list[Choice]:
        """The finalists in the order of their score on every rod that the DLO may be; last those left out for time."""
        rods = self._rods
        if not finalists or not rods:
            return finalists
        judged = list[float]()
        for some in self._timer.rounds(finalists, len(rods)):
            played = await self._play([choice.candidate for choice in some], rods)
            expected = np.array([[choice.score_m for choice in some]])
            kinds = [choice.candidate.kind for choice in some]
            judged += self._scoring.judge(np.concatenate((expected, self._scoring.score(played, kinds)))).tolist()
        return [*(finalists[k] for k in np.argsort(judged, kind="stable")), *finalists[len(judged) :]]

    async def _play(self, candidates: Sequence[Candidate], rods: tuple[QuickRod, ...]) -> Played:
        motions: tuple[Motion, ...] = tuple(candidate.motion for candidate in candidates)
        self.spent += len(motions) * len(rods)
        config = self._config
        with self._timer.playing(len(motions) * len(rods)):
            return await self._compute(play, self._model, self._nodes, rods, motions, config.timestep_s, config.threads)


def _made(family: Family, numbers: Iterator[Float64Array], count: int) -> list[Candidate]:
    """The next `count` candidates; fewer when the numbers are used up."""
    candidates = (candidate for candidate in map(family.make, numbers) if candidate is not None)
    return list(itertools.islice(candidates, count))


def _mixed(pools: list[_Pool], count: int) -> tuple[list[Choice], list[Choice]]:
    """The best `count` of all, no more than half from one pool where there are others, since siblings fail together;
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
    """Numbers of `count` children: the aim of each parent corrected; then the same with others around it."""
    parents = pool.best(_ELITE)
    aimed = [pool.family.aimed(parent.candidate.numbers, parent.nodes_world) for parent in parents]
    more = (rng.integers(len(aimed), size=max(0, count - len(aimed)))).tolist()
    return [*aimed, *(aimed[k] + spread * rng.standard_normal(len(spread)) for k in more)]
