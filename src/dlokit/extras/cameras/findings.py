"""Rows of `dlokit doctor` for a kind of camera: its package, the library that it loads, and the devices."""

from collections.abc import Callable, Sequence

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.errors import HardwareError

NO_ANSWER = "no camera answers: check power, cable and network address"


def camera_finding(
    kind: str, package: str, search: Callable[[], Sequence[object] | None], fix: str, *, none: str = NO_ANSWER
) -> DoctorRow:
    """Check the package and the devices; `search` returns None if the package is not installed.

    `fix` is the command that installs the package; `none` is the text if no device is found.
    """
    what = f"{kind} cameras"
    try:
        found = search()
    except HardwareError as error:
        return DoctorRow(what, Severity.ADVICE, str(error), fix)
    if found is None:
        return DoctorRow(what, Severity.OPTIONAL, f"{package} is only needed for {what}", fix)
    return DoctorRow(what, Severity.READY, ", ".join(map(str, found)) or f"{package} works; {none}")
