"""Cameras: the protocol, and its drivers."""
