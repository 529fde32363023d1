"""An observer for dlokit, in a separate package."""
