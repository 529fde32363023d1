"""The Python API: what `import dlokit` gives, one module a subject."""
