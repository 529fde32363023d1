"""Descriptions of robots, DLOs, shapes and the installation."""
