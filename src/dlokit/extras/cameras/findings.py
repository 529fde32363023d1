"""What `dlokit doctor` says of a kind of camera: its package, the library that it loads, and the devices."""

from collections.abc import Callable, Sequence

from dlokit.app.doctor.machine import DoctorRow, Severity
from dlokit.errors import HardwareError

NO_ANSWER = "no camera answers: check power, cable and network address"


def camera_finding(
    kind: str, package: str, search: Callable[[], Sequence[object] | None], fix: str, *, none: str = NO_ANSWER
) -> DoctorRow:
    """Check the package and the devices; `search` returns None where the package is not installed.

    `fix` installs the package; `none` is said where no device is found.
    """
    what = f"{kind} cameras"
    try:
        found = search()
    except HardwareError as error:
        return DoctorRow(what, Severity.ADVICE, str(error), fix)
    if found is None:
        return DoctorRow(what, Severity.OPTIONAL, f"{package} is only needed for {what}", fix)
    return DoctorRow(what, Severity.READY, ", ".join(map(str, found)) or f"{package} works; {none}")
