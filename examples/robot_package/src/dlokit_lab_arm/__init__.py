"""A driver of an arm for dlokit, in a separate package."""
