"""The configuration tree, the process table, the runtimes, and the files of a run."""
