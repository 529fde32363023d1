"""The bench of shaping: suites, sweeps that resume, figures and pictures."""
