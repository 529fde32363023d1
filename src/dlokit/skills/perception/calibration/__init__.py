"""Corrects the camera's pose by looking at the table and at the robot's own hand."""
