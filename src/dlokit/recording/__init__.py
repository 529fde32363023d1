"""Recordings: everything that went over the bus in one MCAP file, and how it is read again."""
