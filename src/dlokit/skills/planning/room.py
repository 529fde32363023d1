"""Room for the hand: whether hand and fingers keep clear of the fixtures from the descent to the ascent of an action.

A quick check for planners, of the hand alone, along the rounded path that the tool takes. The whole arm is checked with
the real trajectories once an action is chosen, and again by the robot before each motion.
"""

from collections.abc import Iterable

import numpy as np

from dlokit.description.arm.model import ArmModel, Gripper
from dlokit.description.scene import Scene
from dlokit.types.action import APPROACH_HEIGHT_M
from dlokit.types.arrays import Float64Array

_MORE_M = 0.001  # an action is planned with this much more clearance than the robot requires: rounding refuses none
_HELD_WIDER_M = 0.002  # fingers that hold a DLO are apart by at most this more than its diameter


def held_width_m(gripper: Gripper, dlo_radius_m: float) -> float:
    """Distance between the fingertips that hold a DLO [m], or more."""
    return min(2.0 * dlo_radius_m + _HELD_WIDER_M, gripper.open_width_m)


class HandRoom:
    """The room of an arm's hand in a scene."""

    def __init__(self, arm: ArmModel, scene: Scene, dlo_radius_m: float) -> None:
        self._arm, self._fixtures = arm, scene.fixtures
        self._held_m = held_width_m(arm.gripper, dlo_radius_m)

    def opening_m(self, tool: Float64Array, openings_m: Iterable[float], *, holds: bool = True) -> float | None:
        """The first of the finger openings [m] with which the tool has room from its descent to its ascent, or None.

        `tool` (W, 4): x, y, z [m], yaw [rad] from grasp to release. Fingers that do not hold (`holds`) are closed.
        """
        if not self._fixtures:
            return next(iter(openings_m), None)
        if not (self.held_along(tool) if holds else self._along(tool, 0.0)):
            return None
        return next((width_m for width_m in openings_m if self._at_both_ends(tool, width_m)), None)

    def held_along(self, tool: Float64Array) -> bool:
        """Whether a tool that holds the DLO has room along its rounded path through waypoints (W, 4)."""
        return self._along(tool, self._held_m)

    def _along(self, tool: Float64Array, width_m: float) -> bool:
        from dlokit.motion.tool_track import rounded_path

        return not self._fixtures or self._clear(rounded_path(np.ascontiguousarray(tool)), width_m)

    def _at_both_ends(self, tool: Float64Array, width_m: float) -> bool:
        """Whether it can descend to the grasp, and ascend from the release."""
        above = np.array([0.0, 0.0, APPROACH_HEIGHT_M, 0.0])
        return all(self._clear(np.stack((end + above, end)), width_m) for end in (tool[0], tool[-1]))

    def _clear(self, tool: Float64Array, width_m: float) -> bool:
        from dlokit.motion.fixture_clearance import FIXTURE_CLEARANCE_M, hand_clearance_m

        enough_m = FIXTURE_CLEARANCE_M + _MORE_M
        return hand_clearance_m(self._arm, tool, width_m, self._fixtures, enough_m) >= enough_m
