"""`dlokit bench observers`: every observer on the same clouds of rods whose nodes are known."""
