"""Two observers for dlokit, in a separate package."""
