"""The exceptions that dlokit raises, as one tree, and the exit codes of its commands.

    DlokitError
    ├── InputError            invalid input from the user                  (exit code 2)
    │   ├── ShapeError        an invalid start or goal shape
    │   ├── ConfigError       an invalid configuration file or value
    │   ├── BadValue          an invalid pose, speed or trajectory
    │   └── MachineError      something this machine lacks (OpenGL, a free port, a package)
    ├── SkillFailure          a skill ran and did not succeed              (outcome ``Failed``)
    ├── SkillRejected         a skill's precondition does not hold         (outcome ``Rejected``)
    ├── CommunicationError    a message cannot be encoded, decoded, or sent
    │   └── SchemaMismatch    the message was written by another version
    ├── StartNotConfirmed     no operator allowed a real arm to move; nothing has moved
    ├── HardwareError         a device does not respond or refuses a request
    │   ├── ClockJumped       a camera's clock was set, or started again; its next pictures are good
    │   └── NoMorePictures    recorded pictures have been played to their end
    ├── ProcessFailure        a process of the live system died, froze, or did not start   (outcome ``failed``)
    └── CheckFailed           a part of another package violates its protocol (`dlokit.testing`)

An error message says what was wrong, what is allowed, and what to do.
"""

import shlex
import sys
from importlib.util import find_spec
from pathlib import Path

EXIT_FAULT = 1
"""Exit code of a command: something went wrong, or a comparison failed."""
EXIT_BAD_INPUT = 2
"""Exit code: the input is invalid, or the machine lacks something."""
EXIT_OTHERWISE = 3
"""Exit code: the command ran to its end with another result than requested."""
EXIT_INTERRUPTED = 130
"""Exit code: interrupted with Ctrl-C."""


class DlokitError(Exception):
    """Base class of all exceptions that dlokit raises."""


class InputError(DlokitError):
    """Invalid input from the user. The command line prints the message and exits with 2."""


class ShapeError(InputError):
    """An invalid start or goal shape."""


class ConfigError(InputError):
    """An invalid configuration file or value."""


class BadValue(InputError, ValueError):
    """An invalid value: a pose that is not finite, a speed of zero, a trajectory of unequal lengths.

    Also a `ValueError`, so that a message that contains one fails to decode like any other malformed message.
    """


class MachineError(InputError):
    """This machine lacks something: OpenGL, a free port, a package."""


CELL_MODULES = frozenset(
    ("cryptography", "cv2", "loky", "mink", "mujoco", "rtbdata", "ruckig", "trimesh", "viser", "websockets", "zenoh")
)
"""Modules of the extra `cell`, without which dlokit tracks clouds and reads recordings."""


_CLONE = Path(__file__).parents[2]
"""The clone, where dlokit runs from one: the folder above ``src``."""


def pip_command(*arguments: str) -> str:
    """The command that installs packages into the Python that runs; an environment of uv has no pip of its own."""
    python = shlex.quote(sys.executable)
    pip = f"{python} -m pip install" if find_spec("pip") else f"uv pip install --python {python}"
    return f"{pip} {shlex.join(arguments)}"


def install_command(extra: str, clone: Path = _CLONE) -> str:
    """The command that adds an extra to the dlokit that runs.

    From a clone, the clone is named: it may not be installed, or be installed with the extras of an older version, of
    which pip says only that they do not exist. From a wheel or an index the name is enough: pip keeps the dlokit that
    is installed, and adds what the extra needs.
    """
    if (clone / "pyproject.toml").is_file():
        return pip_command("-e", f"{clone}[{extra}]")
    return pip_command(f"dlokit[{extra}]")


def lacks_extra(asked_by: str, extra: str) -> MachineError:
    """The error for a part of dlokit whose extra is not installed; `asked_by` is the part, as the user names it."""
    return MachineError(f"{asked_by} needs dlokit's extra `{extra}`, which is not installed: {install_command(extra)}")


def missing_extra(error: ModuleNotFoundError, asked_by: str) -> MachineError | None:
    """The error for a plain installation that was asked for more; None where another module is missing."""
    return lacks_extra(asked_by, "cell") if (error.name or "").partition(".")[0] in CELL_MODULES else None


def require_cell(asked_by: str) -> None:
    """Raise `MachineError` where the extra `cell` is not installed."""
    if any(find_spec(name) is None for name in CELL_MODULES):
        raise lacks_extra(asked_by, "cell")


class _NamedReason(DlokitError):
    def __init__(self, reason: str, detail: str = "") -> None:
        """`reason` is a name, by which a program decides; `detail` explains it to the user."""
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class SkillFailure(_NamedReason):
    """Raised inside a skill that ran and did not succeed; `reason` is one of the names in the skill's api."""


class SkillRejected(_NamedReason):
    """Raised inside a skill, before it has any effect, when the precondition `reason` does not hold."""


class CommunicationError(DlokitError):
    """A message that cannot be encoded, decoded, or sent."""


class SchemaMismatch(CommunicationError):
    """A message written by another version of its type."""


class StartNotConfirmed(DlokitError):
    """No operator has confirmed that a real arm may begin to move; nothing has moved."""


class HardwareError(DlokitError):
    """A device does not respond or refuses a request."""


class ClockJumped(HardwareError):
    """The stamp of a picture contradicts the host's clock: the device's clock was set, or the device started again."""


class NoMorePictures(HardwareError):
    """Recorded pictures have been played to their end."""


class ProcessFailure(_NamedReason):
    """A process of the live system that died, froze, or did not start: `reason`, e.g. ``"process_died: camera"``."""


class CheckFailed(DlokitError, AssertionError):
    """All requirements of a protocol that a part violates, found by `dlokit.testing`."""


def raise_interrupt(error: BaseException) -> None:
    """Raise the Ctrl-C that `error` stands for, if any: Numba's compiled code turns one into a `SystemError`."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        cause = cause.__cause__ or cause.__context__
