"""The judge of a run: the hidden truth and the evaluator, which alone reads it."""
