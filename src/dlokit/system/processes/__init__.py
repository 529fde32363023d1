"""The processes of a live system: start, supervision, compute workers, stop, and discovery from any shell."""
