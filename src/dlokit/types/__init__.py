"""All values and messages that cross a component boundary, and nothing else.

Each file has one concept; import from the file, e.g. ``from dlokit.types.dlo import DloState``.
"""
