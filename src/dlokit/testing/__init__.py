"""Conformance checks for people who add an observer or an action strategy, in dlokit or in a package of their own."""

from dlokit.errors import CheckFailed
from dlokit.testing.observers import ObserverReport, check_observer

__all__ = ["CheckFailed", "ObserverReport", "check_observer"]
