"""The decision layer: tasks as flow charts, run by calling skills."""
