"""`dlokit.bench`: compare planners and observers, your own among them, without packaging them first."""

from dlokit.extras.bench.comparing import Choice, ObserverComparison, ShapingComparison, observers, shaping

__all__ = ["Choice", "ObserverComparison", "ShapingComparison", "observers", "shaping"]
