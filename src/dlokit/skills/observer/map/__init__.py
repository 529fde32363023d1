"""The default observer: the most probable nodes of a rod."""
