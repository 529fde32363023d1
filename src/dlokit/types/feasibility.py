"""Whether a shape can be worked with, and if not, why."""

import enum

from dlokit.types.message import Value


class Problem(enum.Enum):
    """What can be wrong with a start or goal shape."""

    OFF_TABLE = "off_table"
    OUT_OF_REACH = "out_of_reach"
    OUT_OF_VIEW = "out_of_view"
    BENDS_TOO_TIGHTLY = "bends_too_tightly"
    CROSSES_ITSELF = "crosses_itself"


class Finding(Value, frozen=True, kw_only=True, eq=False):
    """One problem of a shape."""

    problem: Problem
    node: int
    """The node where it is worst."""
    text: str
    """What is wrong and where, what is allowed, and what to do."""


class Verdict(Value, frozen=True, kw_only=True, eq=False):
    """All problems of a shape; none of them: it is feasible."""

    findings: tuple[Finding, ...] = ()

    @property
    def feasible(self) -> bool:
        """Whether there is nothing against it."""
        return not self.findings

    @property
    def reason(self) -> str:
        """Name of the first problem; empty without any."""
        return self.findings[0].problem.value if self.findings else ""

    @property
    def text(self) -> str:
        """All findings, for people."""
        return " ".join(finding.text for finding in self.findings)
