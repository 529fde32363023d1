"""The steps of the shape flow: skill calls and nothing else."""
