"""Fixtures of tests: a post that leans a little and a box that is turned, on free table."""

from dlokit.description.scene import Box, Post, Scene

POST = Post(name="A", position_m=(0.45, 0.10, 0.0), rpy_deg=(0.0, 10.0, 0.0), diameter_m=0.012, height_m=0.030)
LID = Box(name="lid", position_m=(0.55, -0.1, 0.0), rpy_deg=(0.0, 0.0, 30.0), size_m=(0.1, 0.04, 0.03))
FURNISHED = Scene(fixtures=(POST, LID))
