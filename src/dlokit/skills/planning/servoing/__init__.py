"""Shape servoing: the error that is left while the DLO is held, reduced in closed loop."""
