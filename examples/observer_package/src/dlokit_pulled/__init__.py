"""An observer for dlokit, in a package of its own."""
