"""Entry point of every started process: which components it runs comes on its standard input."""

if __name__ == "__main__":
    # Here, because the workers of a process import its entry point anew, and need none of this.
    from dlokit.system.processes.child import component_of_run, run_child

    run_child(component_of_run)
