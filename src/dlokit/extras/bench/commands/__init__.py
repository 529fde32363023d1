"""Compare and measure; every bench prints a table and writes JSON with --json."""
