"""The command `ffsi`, also `python -m ffsi`: a machine on which it cannot even be loaded gets a message, too."""

import gc
import os
import sys


def main() -> None:
    """Load the command line and run it; always ends in SystemExit."""
    gc.set_threshold(500_000, 20, 20)  # of what is loaded nothing becomes garbage: 0.05 s
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # it would look through all that is installed
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # to start them takes 0.05 s, and nothing here uses them
    try:
        from ffsi.cli.main import main as command
    except (ImportError, MemoryError, OSError) as error:  # a library that finds no memory is an ImportError
        text = f"error: ffsi cannot be loaded: {error}; is its memory limited (ulimit -v), is a package missing?"
        if sys.stderr is not None:
            sys.stderr.write("".join(c if c.isprintable() else "?" for c in text) + "\n")
        sys.exit(4)
    except KeyboardInterrupt:
        sys.exit(130)
    try:
        command()
    finally:
        gc.freeze()  # at its end Python would look through all that was loaded, for 0.25 s


if __name__ == "__main__":
    main()
