"""The interface of the section `[hosts]` of a configuration, with which a live run uses several machines."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, Protocol, Self, cast

from dlokit.recording.disk import Disk
from dlokit.system.config import RunConfig
from dlokit.system.table import ProcessRow

if TYPE_CHECKING:
    from dlokit.system.live_system import LiveSystem
    from dlokit.system.processes.supervisor import Launch


class OtherHosts(Protocol):
    """The settings of a run on several machines: a frozen dataclass, which an annexe provides."""

    def absolute(self) -> Self:
        """With absolute file names."""
        ...

    def check(self, rows: tuple[ProcessRow, ...]) -> None:
        """Raise `ConfigError` for a mistake that would otherwise end a run with these processes later."""
        ...

    def here(self, rows: tuple[ProcessRow, ...]) -> tuple[ProcessRow, ...]:
        """The rows that run on this machine, that of the decision process first. Raises `ConfigError`."""
        ...

    def started(
        self,
        rows: tuple[ProcessRow, ...],
        launch: "Launch",
        config_toml: str,
        say: Callable[[str], None],
        meanwhile: Callable[[], object] | None,
        disk: Disk,
    ) -> "AbstractAsyncContextManager[LiveSystem]":
        """The running system, as `live_system.live_system` starts it on one machine.

        `config_toml` is the configuration of all machines; `say` reports the progress of the others to the operator.
        """
        ...


def other_hosts(config: RunConfig) -> OtherHosts | None:
    """The section of a configuration; None: the run is on one machine."""
    return cast("OtherHosts | None", config.hosts)
