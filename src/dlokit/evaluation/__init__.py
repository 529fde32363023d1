"""What judges a run: the hidden truth, the evaluator, and intervals. It alone reads the truth."""
