"""Calibration of a camera and its table; the corrections that run in the loop are in `skills/perception`."""
