# PYTHON_ARGCOMPLETE_OK
"""The first lines of a program: it loads the rest of it, and says in one line where that does not succeed. Shell.

Nothing of ours is imported before, and of the libraries nothing but what the interpreter has loaded already: a machine
that is short of memory or descriptors gets a line and a status, never a traceback.
"""

import os
import sys

_SYSTEM, _INTERNAL = 71, 70
TRACEBACK = "POSITIONER_TRACEBACK"
"""Set in the environment, it lets what was not foreseen end in a traceback."""


def main() -> int:
    """Load and run the positioner; return its exit status."""
    return load("positioner", "positioner.cli.main")


def load(program: str, module: str) -> int:
    """Run `main` of `module`; return its exit status, or that of a program that cannot be loaded."""
    try:
        command = __import__(module, fromlist=("main",)).main  # importlib might have to be loaded first
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # a library written in Rust panics with less than an Exception
        if os.environ.get(TRACEBACK):
            raise
        line, code = unforeseen(error)
        sys.stderr.write(f"{program}: cannot be loaded: {line}\n")
        return code
    return int(command())


def unforeseen(error: BaseException) -> tuple[str, int]:
    """Return one line about an error that nobody has foreseen, and the exit status: is it the machine's, or ours?"""
    said = " ".join(str(error).split())[:300] or "no more is known"
    if isinstance(error, OSError | MemoryError | ImportError):
        return f"the system refuses: {type(error).__name__}: {said}", _SYSTEM
    where = error.__traceback__
    while where is not None and where.tb_next is not None:
        where = where.tb_next
    place = f" in {where.tb_frame.f_code.co_filename}, line {where.tb_lineno}" if where else ""
    return f"internal error: {type(error).__name__}: {said}{place}; {TRACEBACK}=1 shows more", _INTERNAL


if __name__ == "__main__":
    sys.exit(main())
