"""The observer: estimates target points from a cloud and the previous state (Fig. 3)."""
