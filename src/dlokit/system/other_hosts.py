"""What a live run asks of the section `[hosts]` of its configuration, by which it runs on several machines."""

from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING, ClassVar, Protocol, Self

from dlokit.communication.strategies import StrategyKind
from dlokit.recording.disk import Disk
from dlokit.system.table import ProcessRow

if TYPE_CHECKING:
    from dlokit.system.live_system import LiveSystem
    from dlokit.system.processes.supervisor import Launch


class OtherHosts(Protocol):
    """The settings of a run on several machines: a frozen dataclass, which an annexe brings."""

    name: ClassVar[str]

    def absolute(self) -> Self:
        """With absolute file names."""
        ...

    def check(self, rows: tuple[ProcessRow, ...]) -> None:
        """Raise `ConfigError` for what would end a run with these processes later."""
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
        meanwhile: Callable[[], object],
        disk: Disk,
    ) -> "AbstractAsyncContextManager[LiveSystem]":
        """The running system, as `live_system.live_system` starts it on one machine.

        `config_toml` is the configuration of all machines; `say` tells the operator what the others do.
        """
        ...


HOSTS: StrategyKind[OtherHosts] = StrategyKind("[hosts]", "dlokit.hosts", ())
