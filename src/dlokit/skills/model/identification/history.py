"""What was learnt of a DLO action by action, and how well each action would have been predicted before it."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dlokit.skills.model.config import ModelConfig
from dlokit.skills.model.identification.evidence import (
    FRICTION_LOG,
    STIFFNESS_LOG,
    Evidence,
    evidence,
)
from dlokit.skills.model.identification.experience import Experience
from dlokit.skills.model.identification.posterior import Posterior, believed, posterior
from dlokit.types.dlo_belief import DloBelief


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """One action that said something."""

    action: int
    """Number of the action in its run, from 1."""
    moved_m: float
    """How far it moved the node that it moved most [m]."""
    configured_m: float
    """How far the rod as configured predicts the nodes from where they came to lie (RMSE) [m]."""
    learnt_m: float
    """The same for the rod as learnt from the actions before [m]."""
    belief: DloBelief
    """After it."""


def lessons(config: ModelConfig, seen: Iterable[tuple[int, Experience]], threads: int = 0) -> list[Lesson]:
    """Learn from experiences in their order; those that tell nothing are left out."""
    heard: list[Evidence] = []
    found: list[Lesson] = []
    known = posterior(config, heard)
    configured = _nearest_rod(known)
    for action, experience in seen:
        said = evidence(config, experience, threads)
        if said is None:
            continue
        before = _nearest_rod(known)
        heard.append(said)
        known = posterior(config, heard)
        found.append(
            Lesson(
                action=action,
                moved_m=float(experience.moved_m.max()),
                configured_m=float(said.rmse_m[configured]),
                learnt_m=float(said.rmse_m[before]),
                belief=believed(config, known, len(heard), stamp_ns=round(experience.times_s[-1] * 1e9)),
            )
        )
    return found


def _nearest_rod(of: Posterior) -> tuple[int, int, int]:
    """The rod of the grid that is nearest to a belief."""
    layer = of.probability[of.best_yield]
    layer = layer / layer.sum()
    friction = float((layer.sum(axis=1) * of.friction_log).sum())
    stiffness = float((layer.sum(axis=0) * of.stiffness_log).sum())
    return (
        of.best_yield,
        int(np.abs(FRICTION_LOG - friction).argmin()),
        int(np.abs(STIFFNESS_LOG - stiffness).argmin()),
    )
