"""Entry point of every started process; its components are given on standard input."""

if __name__ == "__main__":
    # Imported here, because the workers of a process import its entry point again, and do not need this.
    from dlokit.system.processes.child import run_child
    from dlokit.system.processes.process_end import without_teardown

    with without_teardown():
        run_child()
