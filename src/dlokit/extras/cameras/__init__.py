"""Cameras that are devices: RealSense, GenICam pairs, SceneScan."""
