"""Planning: grasp points, paths, feasibility."""
