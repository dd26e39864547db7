"""The start of a program: it loads the other modules; where that fails, it gives the reason in one line. Shell.

It imports only modules that the interpreter has loaded already: a machine that is short of memory or descriptors
gives a line and an exit status, never a traceback.
"""

import os
import sys

_SYSTEM, _INTERNAL, _INTERRUPTED = 71, 70, 130
TRACEBACK = "POSITIONER_TRACEBACK"
"""Name of an environment variable: where it is set, an unexpected error ends in a traceback."""


def main() -> int:
    """Load and run the positioner; return its exit status."""
    return load("positioner", "positioner.cli.main")


def load(program: str, module: str) -> int:
    """Run what `module` has `prepared`; return its exit status, or that of a program that cannot be loaded."""
    try:
        command = __import__(module, fromlist=("prepared",)).prepared()  # importlib might have to be loaded first
    except KeyboardInterrupt:  # loading takes seconds on a busy machine
        return _INTERRUPTED
    except SystemExit:
        raise
    except BaseException as error:  # a library written in Rust panics with a BaseException
        if os.environ.get(TRACEBACK):
            raise
        line, code = unexpected(error)
        sys.stderr.write(f"{program}: cannot be loaded: {line}\n")
        return code
    return int(command())


def unexpected(error: BaseException) -> tuple[str, int]:
    """Return one line about an unexpected error, and the exit status: of a refusal by the system, or of a defect."""
    text = " ".join(str(error).split())[:300] or "without a text"
    if isinstance(error, OSError | MemoryError | ImportError):
        return f"the system refuses: {type(error).__name__}: {text}", _SYSTEM
    where = error.__traceback__
    while where is not None and where.tb_next is not None:
        where = where.tb_next
    place = f" in {where.tb_frame.f_code.co_filename}, line {where.tb_lineno}" if where else ""
    return f"internal error: {type(error).__name__}: {text}{place}; {TRACEBACK}=1 shows more", _INTERNAL


if __name__ == "__main__":
    sys.exit(main())
