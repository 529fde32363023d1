"""Calibrate the camera with a ChArUco board: its optics, where it stands, and the table before it."""
