"""The driver of Franka's arms: it runs in dlokit's robot process, the rest in three small processes of its own."""
