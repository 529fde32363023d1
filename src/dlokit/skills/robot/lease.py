"""The lease on a robot: its holder and its end. Pure: the machine's clock is an argument."""

import math
import threading
from collections.abc import Callable

from dlokit.errors import SkillRejected
from dlokit.types.robot import RobotReason

REVIVED_WITHIN_S = 1.0
"""A heartbeat later than this after the end of the lease does not renew it [s]: only a frozen or suspended machine
delays it that much, and the previous motion must not continue."""


class RobotLease:
    """The lease on a robot. Any thread may read and renew it.

    All processes may be frozen together, or the machine suspended. The first heartbeat afterwards may come before any
    watchdog has looked: the lease stays lost until `noted`, so that the arm brakes.
    """

    def __init__(self, monotonic_ns: Callable[[], int], *, needs_operator: bool = False) -> None:
        """`monotonic_ns` never goes back, and advances while the machine is suspended.

        With `needs_operator`, as for a real arm, a holder may move it only after `confirm`.
        """
        self._monotonic_ns = monotonic_ns
        self._needs_operator = needs_operator
        self.confirmed = not needs_operator
        """Whether an operator has confirmed the start to the present holder, or the arm needs no operator."""
        self._lapsed = self._noted = False
        self._lock = threading.Lock()
        self.holder = ""
        """Name of the holder; empty without one."""
        self._duration_ns = 0
        self._ends_ns = 0

    @property
    def lost(self) -> bool:
        """Whether the lease was taken and has expired."""
        return self.left_s <= 0.0

    @property
    def left_s(self) -> float:
        """Time until it expires [s]; inf without a holder."""
        with self._lock:
            if not self.holder:
                return math.inf
            return 0.0 if self._lapsed else (self._ends_ns - self._monotonic_ns()) / 1e9

    def confirm(self) -> None:
        """Note that an operator has confirmed the start; it holds until the lease is returned or changes hands."""
        with self._lock:
            self.confirmed = self.holder != "" or not self._needs_operator

    def allows(self, holder: str) -> bool:
        """Whether a motion of that holder may begin: confirmed, and with a lease that runs, or without a holder."""
        return self.confirmed and not self.lost and self.holder in ("", holder)

    def renew(self, holder: str, duration_s: float) -> None:
        """Take or keep the lease. Raises `SkillRejected` ``leased`` while another holds it."""
        with self._lock:
            self._refuse_others(holder)
            if holder != self.holder:
                self.confirmed, self._lapsed = not self._needs_operator, False
                self._ends_ns = self._monotonic_ns()
            self.holder = holder
            self._duration_ns = round(duration_s * 1e9)
            self._extend()

    def hear(self, holder: str) -> None:
        """Extend the lease from now on by its duration; a heartbeat that is not the holder's has no effect."""
        with self._lock:
            if holder and holder == self.holder:
                self._extend()

    def noted(self) -> None:
        """Note that the arm was braked for the lost lease: from now on a renewed lease counts."""
        with self._lock:
            self._lapsed, self._noted = False, True

    def release(self, holder: str) -> None:
        """Return the lease. Raises `SkillRejected` ``leased`` while another holds it."""
        with self._lock:
            self._refuse_others(holder)
            self.confirmed = not self._needs_operator
            self.holder = ""

    def _extend(self) -> None:
        now_ns = self._monotonic_ns()
        self._lapsed |= not self._noted and now_ns - self._ends_ns > REVIVED_WITHIN_S * 1e9
        self._noted = False
        self._ends_ns = now_ns + self._duration_ns

    def _refuse_others(self, holder: str) -> None:
        if self.holder not in ("", holder) and self._monotonic_ns() < self._ends_ns:
            raise SkillRejected(
                RobotReason.LEASED,
                f"{self.holder} holds the lease of this robot; {holder} may take it after {self.holder} returns it",
            )
