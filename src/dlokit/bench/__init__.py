"""The comparisons, and the evaluator, who alone reads the truth."""
