"""What `dlokit export` writes beyond tables: LeRobot data sets, and videos of runs."""
