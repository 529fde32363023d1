"""How a value becomes bytes and back, and what both ends compare."""
