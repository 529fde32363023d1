"""What is loaded before anything starts, so that neither a first frame nor a first decision waits for a compiler."""

from rich.console import Console

from dlokit.skills.observer.kernels import warm
from dlokit.skills.planning.loading import load
from dlokit.system.config import RunConfig


def prepare(console: Console, config: RunConfig) -> None:
    """Compile and load what the observer and the planner of a run need, and say so in the terminal meanwhile."""
    once = "the first time on a machine it is compiled, for about 20 s"
    with console.status(f"preparing the observer; {once}"):
        warm((config.observer.strategy,))
    with console.status(f"preparing the planner; {once}"):
        load(config.planning.strategy)
