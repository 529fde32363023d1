"""dlokit: bring cables, ropes and wires into the shape you want with a robot and a camera."""

from importlib.metadata import version

__version__ = version("dlokit")
