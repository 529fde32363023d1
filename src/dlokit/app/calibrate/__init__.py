"""Commands that calibrate the camera: its optics, where it stands, and the table before it."""
