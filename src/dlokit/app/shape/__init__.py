"""Commands that shape a DLO: `shape`, `demo`, `resume`."""
