"""What a process is told when it is started, on the first line of its standard input."""

import msgspec

from dlokit.communication.zenoh.session import ZenohConfig
from dlokit.system.processes import TimeBase


class ChildSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All that differs from one process to another."""

    process: str
    components: tuple[str, ...]
    bus: ZenohConfig
    time_base: TimeBase
    config_file: str
    """Path of the run's configuration."""
    run_dir: str
    instances: dict[str, tuple[str, ...]] = {}
    """What there is more than one of, besides the first, by component."""
    page_key: str
    """Key of the viewer's page; it is given here because lists of processes show arguments to everybody."""
    beat_fd: int
    """Inherited pipe: `READY` once, then `BEAT` again and again."""
    outlives_s: float = 0.0
    """It goes on for so long when its standard input ends [s]."""
    after: tuple[str, ...] = ()
    """Components that must be on the bus before this process says that it is ready."""
    others_within_s: float = 60.0
    """It waits so long for them, and for the first tick of the cell's clock where it follows that [s]."""


READY = b"r"
BEAT = b"."

BEAT_PERIOD_S = 0.5
"""Heartbeat period, on the machine's clock."""

EXIT_BAD_INPUT = 2
"""A process ends with this when its configuration or machine cannot work; the last line of its log says why."""

STOP_GRACE_S = 5.0
"""A process that is asked to end gets this long before it is killed: the arm brakes, files are closed."""


def encode_spec(spec: ChildSpec) -> bytes:
    """One line."""
    return msgspec.json.encode(spec) + b"\n"


def decode_spec(line: bytes) -> ChildSpec:
    """The spec in a line."""
    return msgspec.json.decode(line, type=ChildSpec)
