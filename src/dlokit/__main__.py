"""`python -m dlokit`, equivalent to the command `dlokit`."""

from dlokit.app.main import main

if __name__ == "__main__":  # a process that is spawned imports this module again
    main()
