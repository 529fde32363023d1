"""The strategy `rollout`: actions played through on the planning rod."""
