"""The components of the paper's Fig. 3, a folder each."""
