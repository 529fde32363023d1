"""The commands `dlokit bench ...`."""
