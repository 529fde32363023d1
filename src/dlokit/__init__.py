"""dlokit: bring cables, ropes and wires into the shape you want with a robot and a camera."""


def __getattr__(name: str) -> str:
    if name == "__version__":
        # Looked up on access: the import takes as long as NumPy's, and every process would wait for it.
        from importlib.metadata import version

        return version("dlokit")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
