"""Hardware behind small protocols."""
