"""Conformance checks for people who add an observer, planner, segmentation, camera, arm or robot, also elsewhere."""
