"""Calibrate the camera with a ChArUco board: its optics, its pose, and the table in front of it."""
