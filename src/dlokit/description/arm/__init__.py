"""Models of arms, and the poses of their bases."""
