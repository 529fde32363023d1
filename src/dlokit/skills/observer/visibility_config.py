"""When a node counts as seen."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class VisibilityConfig:
    """When a node counts as seen."""

    radius_m: float = 0.015
    """Points nearer than this support a node [m]; about a node spacing."""
    least_points: int = 3
    """A node with fewer supporting points is hidden."""
    robot_margin_m: float = 0.01
    """The robot hides what lies at least so far behind its surface [m]."""
    picture_margin_px: float = 3.0
    """A node nearer to the border of the picture than this is out of view [px]."""
