"""Entry point of a process with a disturbed bus; its first argument is the file that selects the disturbance."""

if __name__ == "__main__":
    # Here, because the workers of a process import its entry point anew, and need none of this.
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).parents[2]))  # as for the study

    from dlokit.system.processes.child import component_of_run, run_child
    from parts.faults.disturbance import disturbed_by

    run_child(component_of_run, disturbed_by(Path(sys.argv[1])))
