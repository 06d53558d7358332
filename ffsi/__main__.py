"""The command `ffsi`, also `python -m ffsi`: a machine on which it cannot even be loaded gets a message, too."""

import atexit
import gc
import os
import sys


def main() -> None:
    """Load the command line and run it; always ends the process."""
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
    except SystemExit as end:  # whose streams are flushed
        if sys.getprofile() or sys.gettrace() or not isinstance(end.code, int):
            raise
        atexit._run_exitfuncs()
        os._exit(end.code)  # else Python would take apart all that was loaded: 0.03 s, without the threshold 0.25 s


if __name__ == "__main__":
    main()
