"""`check_observer`: whether an observer keeps to its protocol."""

import time
from dataclasses import dataclass

import numpy as np

from dlokit.extras.checks import scenes
from dlokit.extras.checks.checks import findings, require_none
from dlokit.extras.checks.observer_checks import BUILDS, OBSERVER_CHECKS, Build, branched_off_m
from dlokit.extras.checks.settings import settings_checks
from dlokit.rod.believed import BelievedDlo
from dlokit.skills.observer.base import ObserverStrategy, ObserverStrategyConfig
from dlokit.skills.observer.config import strategies


@dataclass(frozen=True, kw_only=True)
class ObserverReport:
    """Result for an observer that passed every check."""

    name: str
    passed: tuple[str, ...]
    """Names of the checks."""
    follows_branches: bool
    gives_covariance: bool
    memory: tuple[str, ...]
    """Names of what it keeps from cloud to cloud; empty: it keeps nothing."""
    memory_bytes: int
    """Size of the memory with 50 nodes [bytes]."""
    frame_p50_s: float
    """Half of the frames took less processor time [s]; 50 nodes, 2000 points."""
    frame_p99_s: float
    """99 % of the frames took less [s]."""

    def __str__(self) -> str:
        branches = "follows branched DLOs" if self.follows_branches else "plain rods only"
        covariance = "with covariance" if self.gives_covariance else "without covariance"
        memory = "no memory"
        if self.memory:
            memory = f"memory of {self.memory_bytes / 1024:.1f} KiB ({', '.join(self.memory)})"
        return (
            f"{self.name}: {len(self.passed)} checks passed; {branches}, {covariance}, {memory}; a frame of 50 nodes "
            f"and 2000 points takes {self.frame_p50_s * 1e3:.1f} ms (p50), {self.frame_p99_s * 1e3:.1f} ms (p99)"
        )


def check_observer(
    observer: ObserverStrategyConfig | type[ObserverStrategyConfig], *, frames: int = 30
) -> ObserverReport:
    """Try every requirement of the observer protocol on built-in clouds.

    `observer` is a configuration class, checked with its defaults, or an instance of one; it need not be installed.
    `frames` are timed for the report only. Raises `CheckFailed`, which lists all findings.
    """
    kind = observer if isinstance(observer, type) else type(observer)
    found = findings(settings_checks("observer", dict(strategies())), kind)

    def build() -> ObserverStrategy:
        return (observer() if isinstance(observer, type) else observer).build(BelievedDlo())

    cannot = findings((BUILDS,), build)
    found += cannot or findings(OBSERVER_CHECKS, build)
    require_none(f"observer {kind.__module__}:{kind.__qualname__}", found)
    return _report(kind.name, build, frames)


def _report(name: str, build: Build, frames: int) -> ObserverReport:
    strategy = build()
    prior = scenes.before(50)
    targets = strategy.estimate(scenes.cloud(), prior)  # the first frame may compile
    took_s: list[float] = []
    for number in range(frames):
        seen = scenes.cloud(0.01, count=2000, seed=number)
        begin = time.process_time()
        strategy.estimate(seen, prior)
        took_s.append(time.process_time() - begin)
    passed = (*settings_checks("observer", {}), BUILDS, *OBSERVER_CHECKS)
    return ObserverReport(
        name=name,
        passed=tuple(check.name for check in passed),
        follows_branches=branched_off_m(build) is not None,
        gives_covariance=targets.covariance is not None,
        memory=tuple(targets.memory),
        memory_bytes=sum(array.nbytes for array in targets.memory.values()),
        frame_p50_s=float(np.quantile(took_s, 0.5)),
        frame_p99_s=float(np.quantile(took_s, 0.99)),
    )
