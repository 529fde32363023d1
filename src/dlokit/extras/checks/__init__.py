"""Conformance checks for observers, planners, segmentations, cameras, arms and robots, also of other packages."""
