"""Goals that the operator sets by hand."""
