"""Encoding of values as bytes, and the schema fingerprints that both ends compare."""
