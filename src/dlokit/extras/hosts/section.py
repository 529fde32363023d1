"""The section `[hosts]` of a configuration, as a run uses it."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

from dlokit.extras.hosts.config import HostsConfig, kind_of
from dlokit.recording.disk import Disk
from dlokit.system.config import RunConfig
from dlokit.system.table import ProcessRow

if TYPE_CHECKING:
    from dlokit.system.live_system import LiveSystem
    from dlokit.system.processes.supervisor import Launch


@dataclass(frozen=True, kw_only=True)
class HostsSection(HostsConfig):
    """A run on several machines."""

    name: ClassVar[str] = "hosts"

    def absolute(self) -> Self:
        """The same settings with absolute file names."""
        return replace(self, certificates=str(self.folder.absolute())) if self.certificates else self

    def check(self, rows: tuple[ProcessRow, ...]) -> None:
        """Raise `ConfigError` for a wrong placement, or for a missing certificate of the main host."""
        from dlokit.extras.hosts.certificates import host_files
        from dlokit.extras.hosts.placement import placed

        placement = placed(self, rows)
        if kind_of(self.endpoint) == "tls":
            host_files(self.folder, placement.main)

    def here(self, rows: tuple[ProcessRow, ...]) -> tuple[ProcessRow, ...]:
        """The rows that run on this machine. Raises `ConfigError` for a wrong placement."""
        from dlokit.extras.hosts.placement import placed

        return placed(self, rows).own

    def started(
        self,
        rows: tuple[ProcessRow, ...],
        launch: "Launch",
        config_toml: str,
        say: Callable[[str], None],
        meanwhile: Callable[[], object] | None,
        disk: Disk,
    ) -> "AbstractAsyncContextManager[LiveSystem]":
        """The running system, as `live_system.live_system` starts it on one machine."""
        from dlokit.extras.hosts.live import spread_system

        return spread_system(rows, launch, self, config_toml, say, meanwhile, disk)


def section_of(config: RunConfig) -> HostsSection | None:
    """The section of a configuration; None: the run is on one machine."""
    return config.hosts if isinstance(config.hosts, HostsSection) else None
