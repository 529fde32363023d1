"""The cell that stands in for reality."""
