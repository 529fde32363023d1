"""Commands for recorded data: `info`, `record`, `replay`, `export`, `identify`, `track`."""
