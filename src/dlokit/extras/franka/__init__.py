"""The driver of Franka's arms, which runs in dlokit's robot process and starts three small processes."""
