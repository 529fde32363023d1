"""Requirements, and a function that tries all of them on one strategy and reports the findings together."""

import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from dlokit.errors import CheckFailed

S = TypeVar("S")


@dataclass(frozen=True, kw_only=True)
class Check(Generic[S]):
    """One requirement."""

    name: str
    wanted: str
    """The requirement and the remedy, shown beside every finding."""
    run: Callable[[S], Iterator[str]]
    """Yields the findings; none if the requirement is met."""


@dataclass(frozen=True, kw_only=True)
class Unmet:
    """One requirement that is not met."""

    check: str
    wrong: str
    wanted: str


def findings(checks: Sequence[Check[S]], subject: S) -> list[Unmet]:
    """All findings for `subject`; an exception is a finding as well."""
    found: list[Unmet] = []
    for check in checks:
        wrong: list[str] = []
        try:
            wrong.extend(check.run(subject))
        except Exception as error:  # the code under test may raise anything
            wrong.append(f"raised {_raised(error)}")
        found += [Unmet(check=check.name, wrong=text, wanted=check.wanted) for text in wrong]
    return found


def require_none(what: str, found: Sequence[Unmet]) -> None:
    """Raise `CheckFailed` with every finding; return if `findings` is empty."""
    if not found:
        return
    failed = list(dict.fromkeys(finding.check for finding in found))
    lines = [f"{what} does not keep to its protocol; failed: {', '.join(failed)}"]
    for finding in found:
        lines += [f"  - {finding.check}: {finding.wrong}", f"    wanted: {finding.wanted}"]
    raise CheckFailed("\n".join(lines))


def _raised(error: Exception) -> str:
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {' '.join(str(error).split())} ({last.filename}:{last.lineno})"
