"""Recordings: write all messages and calls on the bus to one MCAP file, read them, and replay components from them."""
