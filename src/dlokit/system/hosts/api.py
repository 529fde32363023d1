"""What a host of a run on several machines can be asked to do, by the decision's host."""

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.types.message import Value

A_DAY_S = 86_000.0


class HostFacts(Value, frozen=True, kw_only=True, eq=False):
    """What a host says of itself."""

    version: str
    """Of dlokit."""
    wall_ns: int
    """Time of day there [ns since 1970]."""


class ShareReady(Value, frozen=True, kw_only=True, eq=False):
    """All processes of a host's share are ready."""

    host: str


def _hello() -> HostFacts:
    """Say which version runs here, and what time it is."""
    ...


def _run_share(config_toml: str, processes: tuple[str, ...]) -> None:
    """Start these processes with this configuration, and watch them until the call is cancelled.

    Fails with what ended them, e.g. ``process_died: robot``. Rejected with: bad_configuration, busy.
    """
    ...


HELLO = Skill("host", "hello", _hello, 10.0)
RUN_SHARE = ReportingSkill(
    "host", "run_share", _run_share, A_DAY_S, "", "its processes have ended", exclusive="share", reports=ShareReady
)
