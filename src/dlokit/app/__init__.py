"""The command line and the run report."""
