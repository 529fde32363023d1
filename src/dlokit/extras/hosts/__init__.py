"""Live systems on several machines."""
