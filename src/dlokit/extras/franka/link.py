"""The connection to an FR3 through franky: all calls of the streaming process to the library.

Used only in the streaming process. The library is imported when it is called; only NumPy is loaded before.
"""

import importlib
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from dlokit.errors import install_command, pip_command
from dlokit.extras.franka.reflexes import NAMES, ArmMode
from dlokit.types.arrays import Float64Array

STIFFNESS_NM_RAD = np.array([600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0])
"""Stiffness of the joint impedance; 600 at the wrist reaches its torque limit of 12 N·m. Critically damped."""
_RAMP_OUT_S = 0.02
"""At the end of a motion the arm's own controller takes over from the torques after this time [s]."""
_LONGEST_OUT_S = 0.3
INSTALL = install_command("franka")
_WHEELS = "https://timschneider42.github.io/franky/whl/by-robot-server-version/<version>/"


class LinkLost(Exception):
    """The arm does not answer, or refuses the connection; the text names the cause and the remedy."""


class Reading(NamedTuple):
    """One state of the arm."""

    robot_ms: int
    mode: int
    q: Float64Array  # (7,) [rad]
    dq: Float64Array  # (7,) [rad/s]
    tau: Float64Array  # (7,) [N·m]
    wrench: Float64Array  # (6,) in the base frame [N, N·m]
    T_base_tool: Float64Array  # (4, 4)
    T_flange_tool: Float64Array  # (4, 4)
    tool_kg: float
    load_kg: float


@dataclass(frozen=True, kw_only=True)
class Protection:
    """The protection settings that the arm gets after each connection and each recovery."""

    torque_nm: float
    """Estimated external torque of a joint at which the arm stops [N·m]."""
    force_n: float
    """Estimated external force on the tool at which the arm stops [N]; for torques on the tool [N·m], a tenth."""
    load_kg: float
    load_at_m: tuple[float, float, float]
    """Centre of the load in the flange's frame [m]."""


class Link(Protocol):
    """An arm that follows set-points."""

    @property
    def ahead_s(self) -> float:
        """Time by which a set-point is sent before it applies [s]."""
        ...

    def read(self) -> Reading:
        """The newest state. Raises `LinkLost`."""
        ...

    def begin(self) -> None:
        """Take control at the present angles. Raises `LinkLost`."""
        ...

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        """The set-point until the next one."""
        ...

    def end(self) -> None:
        """Return control without waiting; `in_control` becomes false."""
        ...

    @property
    def in_control(self) -> bool:
        """Whether set-points are followed."""
        ...

    def errors(self) -> int:
        """Error word of the motion that the arm ended. Raises `LinkLost` when a lost connection ended it."""
        ...

    def recover(self) -> bool:
        """Clear errors, and set the protection again; returns whether the arm accepted it. Raises `LinkLost`."""
        ...


class FrankyLink:
    """A `Link` by franky's joint impedance tracker."""

    ahead_s = 0.002
    """A set-point applies to the middle of the time until the next one arrives at the arm."""

    def __init__(self, address: str, protection: Protection, real_time: bool) -> None:
        """Connect and set the protection. Raises `LinkLost`."""
        self._protection = protection
        try:
            self._franky: Any = importlib.import_module("franky")
        except ImportError as error:
            raise LinkLost(f"the arm needs franky-control, which cannot be imported ({error}): {INSTALL}") from error
        franky = self._franky
        kind = franky.RealtimeConfig.Enforce if real_time else franky.RealtimeConfig.Ignore
        try:
            self._robot: Any = franky.Robot(address, realtime_config=kind)
            self._protect()
        except franky.IncompatibleVersionException as error:
            raise LinkLost(wrong_version(str(error))) from error
        except franky.RealtimeException as error:
            raise LinkLost(
                f"{str(error).rstrip('.')}; install a PREEMPT_RT kernel, and allow this user rtprio 99 and memlock "
                "unlimited in /etc/security/limits.conf (for a simulator of the arm: --driver.no-real-time)"
            ) from error
        except franky.CommandException as error:
            raise LinkLost(
                f"the arm refuses the collision thresholds or the load ({error}); correct --driver.collision-torque-nm,"
                " --driver.collision-force-n or --driver.load-kg"
            ) from error
        except Exception as error:  # the library raises plain errors as well, for a lost network
            said = str(error).rstrip(".")
            raise LinkLost(
                f"no connection to {address}: {said}. Is the arm on, unlocked, and FCI activated in Desk?"
            ) from error
        self._tracker: Any = None
        self._tool: tuple[Any, ...] | None = None

    def _protect(self) -> None:
        wanted = self._protection
        force = [wanted.force_n] * 3 + [0.1 * wanted.force_n] * 3
        self._robot.set_collision_behavior([wanted.torque_nm] * 7, force)
        self._robot.set_load(wanted.load_kg, list(wanted.load_at_m), [0.0] * 9)
        self._tool = None

    @property
    def urdf(self) -> str:
        """The arm's own description, with its limits. Raises `LinkLost`."""
        try:
            return str(self._robot.model_urdf)
        except Exception as error:  # as in `_state`
            raise LinkLost(f"the arm does not send its own description, with its limits: {error}") from error

    def read(self) -> Reading:
        """The newest state; during control from a cache, else with the arm's next packet."""
        state = self._state()
        return Reading(
            robot_ms=state.time.to_msec(),
            mode=int(state.robot_mode),
            q=state.q,
            dq=state.dq,
            tau=state.tau_J,
            wrench=state.O_F_ext_hat_K,
            T_base_tool=state.O_T_EE.matrix,
            T_flange_tool=state.F_T_EE.matrix,
            tool_kg=state.m_ee,
            load_kg=state.m_load,
        )

    def begin(self) -> None:
        """Start the tracker."""
        try:
            self._tracker = self._franky.JointImpedanceTracker(self._robot, stiffness=STIFFNESS_NM_RAD)
        except self._franky.ControlException:
            return  # `in_control` stays false, and `errors` reports the cause
        except Exception as error:  # as in `_state`
            raise LinkLost(f"the arm does not start a motion: {error}") from error

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        """Pass the set-point to the control thread."""
        self._tracker.set_target(q, dq=dq)  # always with dq: without it the arm lags by tenths of a radian

    def end(self) -> None:
        """Queue a short stop of the torques, after which the arm's own controller holds."""
        stop = self._franky.TorqueStopMotion(ramp_duration=_RAMP_OUT_S, max_duration=_LONGEST_OUT_S)
        try:
            self._robot.move(stop, asynchronous=True)
        except Exception:  # control has just ended on its own: `errors` reports the cause
            return

    @property
    def in_control(self) -> bool:
        """Whether the control thread runs."""
        return bool(self._robot.is_in_control)

    def errors(self) -> int:
        """Collect the end of the motion."""
        franky = self._franky
        aborted = False
        try:
            self._robot.poll_motion()
        except franky.NetworkException as error:
            raise LinkLost(f"the connection was cut in a motion: {error}") from error
        except franky.Exception:  # what ended the motion, ControlException among them, is in the state
            aborted = True
        state = self._state()
        # The record of the last abort may outlive motions that end well, as it does in franka-sim.
        last = word_of(state.last_motion_errors) if aborted else 0
        return last | word_of(state.current_errors)

    def recover(self) -> bool:
        """Clear errors."""
        franky = self._franky
        try:
            if self._state().robot_mode in (franky.RobotMode.Reflex, franky.RobotMode.Other) or self._robot.has_errors:
                self._robot.recover_from_errors()
            self._protect()
        except franky.CommandException:
            return False
        except Exception as error:  # as in `_state`
            raise LinkLost(f"the arm does not answer any more: {error}") from error
        return int(self._state().robot_mode) == ArmMode.IDLE

    def _state(self) -> Any:
        try:
            return self._robot.state
        except Exception as error:  # NetworkException, or RuntimeError("Net Exception")
            raise LinkLost(f"the arm does not answer any more: {error}") from error


def word_of(flags: Any) -> int:
    """The error word of libfranka's flags."""
    return sum(1 << bit for bit, name in enumerate(NAMES) if getattr(flags, name))


def wrong_version(said: str) -> str:
    """The remedy for a server of another version; `said` is the library's message, with both versions."""
    return (
        f"the arm's firmware speaks another version of the protocol than the installed franky-control: {said}. Update "
        "the firmware, or install the wheel for the server version that is named: "
        f"{pip_command('--pre', 'franky-control', '--extra-index-url')} {_WHEELS} (server version 5 "
        f"is a Panda: --arm panda, {install_command('panda')})"
    )
