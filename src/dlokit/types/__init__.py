"""Every value and message that crosses a component boundary, and nothing else.

One concept a file; import from the file, e.g. ``from dlokit.types.dlo import DloState``.
"""
