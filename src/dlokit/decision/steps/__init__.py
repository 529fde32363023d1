"""What the boxes of the shape flow do: skill calls and nothing else."""
