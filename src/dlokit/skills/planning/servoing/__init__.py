"""Shape servoing: reduces the remaining error in closed loop while the DLO is held."""
