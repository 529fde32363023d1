"""The connection to a Panda through franka-rs: all calls of the streaming and the hand process to the library.

The library is imported when it is called. Its thread moves the arm towards the newest target by impedance control,
within the limits of the joints, and sends a torque every millisecond.
"""

import importlib
import threading
from typing import Any

import numpy as np

from dlokit.errors import install_command
from dlokit.extras.franka.link import STIFFNESS_NM_RAD, LinkLost, Protection, Reading
from dlokit.extras.franka.reflexes import NAMES, ArmMode
from dlokit.types.arrays import Float64Array

ARM = "panda"
"""Name of the arm's model that uses this connection; all other models use franky."""
MARGIN_RAD = 0.06
"""The library refuses targets closer than 0.05 rad to the end of a joint's range; the rest is for the trim."""
_AHEAD_S = 0.045
"""Time by which the arm lags behind its target [s]: the library takes no velocities, and smooths the targets."""
_FARTHEST_RAD = 7.0
"""The library's own limit of a motion's length, wider than any joint's range: the gate has checked the motion."""
_PANDA_VERSION = 5
"""Version of the protocol that every Panda speaks; FR3s speak later ones."""
INSTALL = install_command("panda")


class FrankaRsLink:
    """A `Link` by franka-rs' joint targets."""

    ahead_s = _AHEAD_S

    def __init__(self, address: str, protection: Protection, real_time: bool) -> None:
        """Connect and set the thresholds; the library cannot set a load. Raises `LinkLost`.

        Without `real_time`, for simulators, an FR3 is accepted too: no simulator speaks a Panda's version.
        """
        self._protection = protection
        self._targets: Any = None
        self._ending: threading.Thread | None = None
        self._ended_by: Exception | None = None
        self._franka: Any = imported()
        try:
            self._robot: Any = self._franka.Robot(address, realtime="enforce" if real_time else "ignore")
            self._protect()
        except self._franka.FrankaError as error:
            raise LinkLost(_explained(address, error)) from error
        version = self._robot.fci_version
        if real_time and version != _PANDA_VERSION:
            raise LinkLost(
                f"the arm at {address} speaks version {version} of the protocol; a Panda speaks {_PANDA_VERSION}. It "
                f"is a Franka Research 3: add --arm fr3, and {install_command('franka')}"
            )

    def _protect(self) -> None:
        torques = [self._protection.torque_nm] * 7
        forces = [self._protection.force_n] * 3 + [0.1 * self._protection.force_n] * 3
        self._robot.set_collision_behavior_simple(torques, torques, forces, forces)

    @property
    def urdf(self) -> str:
        """Empty: a Panda does not describe itself."""
        return ""

    def read(self) -> Reading:
        """The newest state; in control from the library's loop, else with the arm's next packet."""
        state = self._targets.state() if self.in_control else self._next()
        return Reading(
            robot_ms=round(1e3 * state.time),
            mode=_mode(state),
            q=state.q,
            dq=state.dq,
            tau=state.tau_J,
            wrench=state.O_F_ext_hat_K,
            T_base_tool=state.O_T_EE,
            T_flange_tool=state.F_T_EE,
            tool_kg=state.m_ee,
            load_kg=state.m_load,
        )

    def begin(self) -> None:
        """Start the library's loop."""
        self._ended_by = self._ending = None
        try:
            self._targets = self._robot.joint_targets(
                fraction=1.0,
                max_deviation=_FARTHEST_RAD,
                joint_stiffness=STIFFNESS_NM_RAD.tolist(),
                velocity_feedforward=True,  # else the damping holds the arm back by tenths of a radian
            )
        except self._franka.ControlException as error:
            self._ended_by = error  # `in_control` stays false, and `errors` reports the cause
        except self._franka.FrankaError as error:
            raise LinkLost(f"the arm does not start a motion: {error}") from error

    def target(self, q: Float64Array, dq: Float64Array) -> None:
        """Pass the set-point to the loop; it is taken `ahead_s` early in place of `dq`."""
        try:
            self._targets.move_to(q)
        except self._franka.FrankaError:
            # The loop has just ended, which `errors` explains; or the set-point is too close to the end of a joint,
            # and the arm waits before it until the streaming process sees that it does not follow.
            return

    def end(self) -> None:
        """End the loop at the arm's present angles, in a separate thread: it waits until it reaches its target."""
        self.target(self._targets.state().q, np.zeros(7))  # an arm that pushes against something stops pushing
        self._ending = threading.Thread(target=self._stop, args=(self._targets,), daemon=True)
        self._ending.start()

    def _stop(self, targets: Any) -> None:
        try:
            targets.stop()
        except Exception as error:  # result of the loop
            self._ended_by = error

    @property
    def in_control(self) -> bool:
        """Whether the loop runs."""
        return self._targets is not None and bool(self._targets.running)

    def errors(self) -> int:
        """Collect the end of the loop."""
        if self._ending is None and self._targets is not None:
            self._stop(self._targets)  # returns at once: the loop has ended on its own
        elif self._ending is not None:
            self._ending.join()
        self._targets = None
        error = self._ended_by
        if error is None:
            return word_of(self._next().current_errors)
        if not isinstance(error, self._franka.ControlException):
            raise LinkLost(f"the connection was cut in a motion: {error}") from error
        return word_of(getattr(error, "errors", ())) | word_of(self._next().current_errors)

    def recover(self) -> bool:
        """Clear errors."""
        try:
            state = self._next()
            if _mode(state) in (ArmMode.REFLEX, ArmMode.OTHER) or state.current_errors:
                self._robot.automatic_error_recovery()
            self._protect()
        except self._franka.FrankaError as error:
            if getattr(error, "kind", "") == "command":
                return False
            raise LinkLost(f"the arm does not answer any more: {error}") from error
        return _mode(self._next()) is ArmMode.IDLE

    def _next(self) -> Any:
        try:
            return self._robot.read_once()
        except self._franka.FrankaError as error:
            raise LinkLost(f"the arm does not answer any more: {error}") from error


class FrankaRsFingers:
    """Franka's hand through franka-rs, with the interface that the hand process expects."""

    def __init__(self, address: str) -> None:
        """Connect."""
        self._gripper: Any = imported().Gripper(address)

    @property
    def state(self) -> Any:
        """Width, largest width; waits for the next packet."""
        return self._gripper.read_once()

    def move(self, width: float, speed: float) -> bool:
        """Blocks while the fingers move."""
        return self._gripper.move(width, speed)

    def grasp(self, width: float, speed: float, force: float, epsilon_inner: float, epsilon_outer: float) -> bool:
        """Blocks until they hold an object or the grasp has failed."""
        return self._gripper.grasp(width, speed, force, epsilon_inner, epsilon_outer)

    def homing(self) -> bool:
        """Blocks while they open and close."""
        return self._gripper.homing()

    def stop(self) -> bool:
        """Hold the present width."""
        return self._gripper.stop()


def imported() -> Any:
    """The library. Raises `LinkLost` if it is missing."""
    try:
        return importlib.import_module("franka")
    except ImportError as error:
        raise LinkLost(f"a Panda needs franka-rs, which cannot be imported ({error}): {INSTALL}") from error


def _mode(state: Any) -> ArmMode:
    return ArmMode[state.robot_mode.upper()]


def word_of(flags: Any) -> int:
    """The error word of franka-rs' names of libfranka's flags; an error with an unknown name needs a person."""
    names = {str(flag).lower().removesuffix("_flag") for flag in flags}
    if names - set(NAMES):
        names = names & set(NAMES) | {"instability_detected"}
    return sum(1 << bit for bit, name in enumerate(NAMES) if name in names)


def _explained(address: str, error: Any) -> str:
    """The remedy for an error of the library on connecting."""
    said = str(error).rstrip(".")
    match getattr(error, "kind", ""):
        case "incompatible_version":
            return (
                f"the arm's firmware speaks another version of the protocol than a Panda's: {said}. franka-rs 0.4 "
                f"speaks version {_PANDA_VERSION}, of system version 4.2.1 and newer: update the Panda's firmware (no "
                "wheel speaks older versions); for an FR3 choose --arm fr3, whose error names the wheel of its version"
            )
        case "realtime":
            return (
                f"{said}; install a PREEMPT_RT kernel, and allow this user rtprio 99 and memlock unlimited in "
                "/etc/security/limits.conf (for a simulator of the arm: --driver.no-real-time)"
            )
        case "command" | "invalid_argument":
            return (
                f"the arm refuses the collision thresholds ({said}); correct --driver.collision-torque-nm or "
                "--driver.collision-force-n"
            )
        case _:
            return f"no connection to {address}: {said}. Is the arm on, unlocked, and FCI activated in Desk?"
