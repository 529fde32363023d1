"""What the arm is made of, and where arms stand."""
