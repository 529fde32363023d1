"""The processes of a live system: started, watched, given work, stopped, and found from any shell."""
