"""Settings that were renamed since earlier versions.

The `config.toml` of an earlier run is read with the present names. The command line and the Python API refuse an
earlier name, and report the present one.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from dlokit.errors import ConfigError

RENAMED: Mapping[str, str] = {
    "task.hopeless_actions": "task.no_progress_actions",
    "planning.feasibility.hold_share": "planning.feasibility.hold_fraction",
    "observer.strategy.misfit_share": "observer.strategy.misfit_fraction",
}
"""Earlier paths of settings in `config.toml` → present paths, in the same table."""


def with_present_names(plain: dict[str, Any]) -> dict[str, Any]:
    """The content of a configuration file with present names. A file that holds both names keeps both."""
    for earlier, present in RENAMED.items():
        (*tables, old), new = earlier.split("."), present.rpartition(".")[2]
        table: Any = plain
        for name in tables:
            table = table.get(name) if isinstance(table, dict) else None
        if isinstance(table, dict) and old in table and new not in table:
            # In place: a file that is written again keeps its order.
            items = [(new if name == old else name, value) for name, value in table.items()]
            table.clear()
            table.update(items)
    return plain


def check_path(path: str) -> None:
    """Raise `ConfigError` for the earlier path of a setting."""
    if path in RENAMED:
        raise ConfigError(f"the setting {path} is called {RENAMED[path]} now.")


def check_options(arguments: Iterable[str]) -> None:
    """Raise `ConfigError` for an option of an earlier name in a command line."""
    for argument in arguments:
        option = argument.partition("=")[0]
        present = RENAMED.get(option.removeprefix("--").replace("-", "_")) if option.startswith("--") else None
        if present is not None:
            raise ConfigError(f"{option} is called --{present.replace('_', '-')} now.")
