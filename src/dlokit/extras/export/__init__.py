"""What `dlokit export` writes: tables, LeRobot data sets, and videos of runs."""
