"""The three-dimensional part of the page."""
