"""`dlokit bench fuzz`: damaged messages through every decoder of the bus."""
