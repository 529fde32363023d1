"""The strategy `rollout`: candidate actions are simulated with the planning rod."""
