"""The simulated cell, which replaces arms, cameras and table."""
