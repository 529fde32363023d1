"""The model: a discrete elastic rod that follows target points."""
