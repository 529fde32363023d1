"""Clocks, heartbeats, deadlines and watchdogs; real-time priority of threads, and linear algebra on one thread."""
