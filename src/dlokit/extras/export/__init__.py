"""Output of `dlokit export`: tables, LeRobot data sets, and videos of runs."""
