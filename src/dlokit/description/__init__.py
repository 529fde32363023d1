"""What things are made of: robots, DLOs, shapes."""
