"""A planner for dlokit, in a separate package."""
