"""Clocks, signs of life, deadlines, and the threads that must not be late."""
