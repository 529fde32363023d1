"""dlokit: bring cables, ropes and wires into the shape you want with a robot and a camera."""


def __getattr__(name: str) -> str:
    if name == "__version__":
        # Looked up when it is asked for: it takes as long as importing NumPy does, and every process would wait.
        from importlib.metadata import version

        return version("dlokit")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
