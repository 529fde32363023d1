"""Verdicts on start and goal shapes, and the nearest feasible shape."""
