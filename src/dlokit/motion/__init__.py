"""Motions of an arm as pure functions: whether a trajectory keeps its limits."""
