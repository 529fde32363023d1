"""The configuration tree, the process table, the runtimes, and what a run leaves behind."""
