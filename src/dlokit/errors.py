"""Everything dlokit raises, in one tree.

    DlokitError
    ├── InputError            the user gave something that cannot work     (exit code 2)
    │   ├── ShapeError        a start or goal shape
    │   ├── ConfigError       a configuration file or value
    │   ├── BadValue          a pose, a speed or a trajectory that cannot be one
    │   └── MachineError      something this machine lacks (OpenGL, a free port, a package)
    ├── SkillFailure          a skill ran and did not reach its end        (outcome ``Failed``)
    ├── SkillRejected         a skill's precondition does not hold         (outcome ``Rejected``)
    ├── CommunicationError    a message cannot be encoded, decoded, or sent
    │   └── SchemaMismatch    it was written by another version
    ├── HardwareError         a driver lost or refused by its device
    ├── ProcessFailure        a process of the live system died, froze, or did not start   (outcome ``failed``)
    └── CheckFailed           a part of another package does not keep to its protocol (`dlokit.testing`)

A message says what was wrong, what was allowed, and what to do.
"""

EXIT_FAULT = 1
"""Exit code of a command: something went wrong, or a comparison failed."""
EXIT_BAD_INPUT = 2
"""What was given cannot work, or the machine lacks something."""
EXIT_OTHERWISE = 3
"""It ran to its end, and what was wanted is not so."""
EXIT_INTERRUPTED = 130
"""Ctrl-C."""


class DlokitError(Exception):
    """Root of what dlokit raises."""


class InputError(DlokitError):
    """The user gave something that cannot work. The command line prints the message and exits with 2."""


class ShapeError(InputError):
    """A start or goal shape that cannot be used."""


class ConfigError(InputError):
    """A configuration file or value that cannot be used."""


class BadValue(InputError, ValueError):
    """A value that cannot be made: a pose that is not finite, a speed of zero, a trajectory of unequal lengths.

    Also a `ValueError`, so that a message that holds one fails to decode like any other malformed message.
    """


class MachineError(InputError):
    """Something this machine lacks: OpenGL, a free port, a package."""


class SkillFailure(DlokitError):
    """Raised inside a skill: it ran and did not reach its end."""

    def __init__(self, reason: str, detail: str = "") -> None:
        """Name the failure by `reason`, one of the names in the skill's api; `detail` is for people."""
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class SkillRejected(DlokitError):
    """Raised inside a skill before it has done anything: a precondition does not hold."""

    def __init__(self, reason: str, detail: str = "") -> None:
        """Name the precondition by `reason`; `detail` is for people."""
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class CommunicationError(DlokitError):
    """A message that cannot be encoded, decoded, or sent."""


class SchemaMismatch(CommunicationError):
    """A message written by another version of its type."""


class HardwareError(DlokitError):
    """A device that is gone or refuses."""


class ProcessFailure(DlokitError):
    """A process of the live system that died, froze, or did not start."""

    def __init__(self, reason: str, detail: str = "") -> None:
        """Name what happened by `reason`, e.g. ``"process_died: camera"``; `detail` is for people."""
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class CheckFailed(DlokitError, AssertionError):
    """What `dlokit.testing` found: every requirement that a part does not keep to, in one message."""
