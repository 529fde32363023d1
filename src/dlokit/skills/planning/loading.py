"""What planning loads before it is asked."""

from dlokit.rod import rollout
from dlokit.skills.planning.base import Loaded, StrategyConfig


def load(strategy: StrategyConfig) -> None:
    """Compile or load the rod that goals are judged with, and what a strategy has to load besides."""
    rollout.warm()
    if isinstance(strategy, Loaded):
        strategy.load()
