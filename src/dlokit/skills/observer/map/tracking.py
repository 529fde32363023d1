"""Solves one problem: coarse stage, fine stage, covariance and health."""

from dataclasses import dataclass

from dlokit.skills.observer.map.coarse import coarse
from dlokit.skills.observer.map.fine import Fitted, fine
from dlokit.skills.observer.map.problem import MapProblem
from dlokit.skills.observer.map.trust import health, stated_covariance
from dlokit.types.arrays import Float64Array


@dataclass(frozen=True, kw_only=True)
class FoundNodes:
    """One answer to a problem."""

    fitted: Fitted
    covariance: Float64Array
    """(M, 3, 3) [m²]."""
    health: float


def tracked(problem: MapProblem) -> FoundNodes:
    """The most probable nodes near the problem's nodes before."""
    nodes, before = coarse(problem)
    fitted = fine(problem, nodes, before)
    covariance = stated_covariance(problem, before, fitted)
    return FoundNodes(fitted=fitted, covariance=covariance, health=health(problem, fitted, covariance))
