"""Clocks, periodic heartbeats, deadlines and their watchdogs, and real-time priority of threads."""
