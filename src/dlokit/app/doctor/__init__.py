"""`dlokit doctor`: check this machine for what dlokit needs."""
