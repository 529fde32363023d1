"""The bench of braking and stopping: what an arm does when its commander is lost or a person stops it."""
