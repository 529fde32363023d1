"""What judges a run: the hidden truth and the evaluator. It alone reads the truth."""
