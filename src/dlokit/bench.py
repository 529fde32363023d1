"""`dlokit.bench`: compare planners and observers, your own among them, without packaging them first."""

from dlokit.app.library.comparing import Choice, ObserverComparison, ShapingComparison, observers, shaping

__all__ = ["Choice", "ObserverComparison", "ShapingComparison", "observers", "shaping"]
