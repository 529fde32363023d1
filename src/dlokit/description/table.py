"""Where on the table a DLO may lie."""

TABLE_X_M = (0.30, 0.75)
"""Part of the table that arm and camera share, along x [m]."""
TABLE_Y_M = (-0.35, 0.35)
"""The same along y [m]."""
