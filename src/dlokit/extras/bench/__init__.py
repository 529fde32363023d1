"""Benches of observers and of shaping: what `dlokit bench` and `dlokit.bench` run."""
