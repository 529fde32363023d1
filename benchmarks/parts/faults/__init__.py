"""Fault injection into running systems."""
