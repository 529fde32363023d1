"""What is checked and loaded before anything starts; imported then, so that `--help` need not wait for it."""

from rich.console import Console

from dlokit.skills.viewer.address import check_port
from dlokit.system.config import RunConfig
from dlokit.system.hosts.placement import main_host
from dlokit.system.table import VIEWER, processes_of_run


def check_before_start(config: RunConfig) -> None:
    """Raise `MachineError` or `ConfigError` for what would end the run anyway. Shapes are not judged here.

    Where the DLO lies is for the system to see, and the goal is judged by the task itself, in the model.
    """
    from dlokit.functional.cell.rendering import check_opengl

    if config.hosts is not None and config.runtime == "live":
        from dlokit.system.hosts.doors import check_hosts

        check_hosts(config.hosts, processes_of_run(simulated=True, watched=not config.headless, arms=config.arms))
    if not config.headless and _viewer_is_here(config):
        check_port(config.viewer.host, config.viewer.port)
    check_opengl()


def _viewer_is_here(config: RunConfig) -> bool:
    if config.hosts is None or config.runtime == "lockstep":
        return True
    return VIEWER.name in config.hosts.runs[main_host(config.hosts)]


def prepare(console: Console, config: RunConfig) -> None:
    """Compile and load what the observer and the planner of a run need, and say so in the terminal meanwhile."""
    from dlokit.skills.observer.kernels import warm
    from dlokit.skills.planning.strategies import load

    once = "the first time on a machine it is compiled, for about 20 s"
    with console.status(f"preparing the observer; {once}"):
        warm((config.observer.strategy,))
    with console.status(f"preparing the planner; {once}"):
        load(config.planning.strategy)
