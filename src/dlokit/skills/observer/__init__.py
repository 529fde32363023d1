"""The observer: from a cloud and the old state to target points (Fig. 3)."""
