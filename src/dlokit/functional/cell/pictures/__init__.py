"""How the cell's cameras see it: rendering, lenses, noise and their clock."""
