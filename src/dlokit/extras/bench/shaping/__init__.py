"""The bench of shaping: suites, resumable sweeps, figures and pictures."""
