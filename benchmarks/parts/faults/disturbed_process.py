"""Entry point of a process with a disturbed bus; its first argument is the file that selects the disturbance."""

if __name__ == "__main__":
    # Here, because the workers of a process import its entry point anew, and need none of this.
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).parents[2]))  # as for the study

    from dlokit.system.processes.child import components_of, run_child
    from parts.faults.disturbance import disturbed_by

    run_child(components_of, disturbed_by(Path(sys.argv[1])))
