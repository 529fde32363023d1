"""Skills of a host in a multi-machine run, called by the main host, which runs the decision process."""

from dlokit.communication.skill import ReportingSkill, Skill
from dlokit.types.message import Value

A_DAY_S = 86_000.0


class HostFacts(Value, frozen=True, kw_only=True, eq=False):
    """Facts that a host reports about itself."""

    version: str
    """Version of dlokit."""
    wall_ns: int
    """Its time of day [ns since 1970]."""


class ShareReady(Value, frozen=True, kw_only=True, eq=False):
    """All processes on a host are ready."""

    host: str


def _hello() -> HostFacts:
    """Report the version of dlokit and the time of day."""
    ...


def _run_share(config_toml: str, processes: tuple[str, ...]) -> None:
    """Start these processes with this configuration, and watch them until the call is cancelled.

    Fails with the cause of their end, e.g. ``process_died: robot``. Rejected with: bad_configuration, busy.
    """
    ...


HELLO = Skill("host", "hello", _hello, 10.0)
RUN_SHARE = ReportingSkill(
    "host", "run_share", _run_share, A_DAY_S, "", "its processes have ended", exclusive="share", reports=ShareReady
)
