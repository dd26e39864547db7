"""Root's way to a state directory of somebody else: a process that becomes its owner and sees nothing but it.

Whoever owns the directory decides what lies in it. So root opens none of it: the process that does has the directory as
its root directory and the owner's rights, and only its answer, checked like any other message, comes back.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from positioner.errors import PositionerError, StateError
from positioner.store import messages
from positioner.store.at_files import at_the_files
from positioner.store.file_check import Fault, TableRejectedError
from positioner.store.interpreter import command, environment

_ANSWER_S = 30.0


def is_needed(directory: Path) -> bool:
    """Return whether this process is root's and the directory is not."""
    return os.geteuid() == 0 and directory.stat().st_uid != 0


def ask(directory: Path, request: messages.Request) -> messages.Answer:
    """Return what `request` gives when the owner of the directory makes it.

    Raises:
        TableRejectedError: the table is none.
        StateError: nothing was changed; the message says why.
    """
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        done = subprocess.run(  # noqa: S603, our own interpreter and module
            command("positioner.store.as_owner", str(descriptor)),
            input=messages.encode(request),
            stdout=subprocess.PIPE,
            pass_fds=(descriptor,),
            env=environment(),
            cwd="/",
            timeout=_ANSWER_S,
            check=False,
        )
        answer = messages.decode(done.stdout)
    except (OSError, subprocess.TimeoutExpired, StateError) as error:
        raise StateError(f"{directory}: cannot be looked into as its owner ({error})") from error
    finally:
        os.close(descriptor)
    match answer:
        case messages.Rejected(name, fault, detail):
            raise TableRejectedError(directory / name, Fault(fault), detail)
        case messages.Refused(reason):
            raise StateError(f"{directory}: {reason}")
        case messages.Done(str(backup)):
            return messages.Done(str(directory / backup.lstrip("/")))
        case messages.Dumped() | messages.Done():
            return answer
    raise StateError(f"{directory}: unexpected answer: {answer}")


def _become_owner(descriptor: int) -> None:
    """Give up everything but the directory and its owner's rights in it."""
    status = os.fstat(descriptor)
    os.fchdir(descriptor)
    os.chroot(".")
    os.setgroups([])
    os.setresgid(status.st_gid, status.st_gid, status.st_gid)
    os.setresuid(status.st_uid, status.st_uid, status.st_uid)


def _answer(line: bytes) -> messages.Answer:
    request = messages.decode(line)
    if not isinstance(request, messages.DumpRequest | messages.ResetRequest | messages.ImportRequest):
        raise StateError(f"not a request: {request}")
    return at_the_files(Path("/"), request)


def main() -> None:
    """Answer the request on the standard input as the owner of the directory whose descriptor is the argument."""
    answer: messages.Answer
    try:
        line = sys.stdin.buffer.read()
        _become_owner(int(sys.argv[1]))
        answer = _answer(line)
    except TableRejectedError as rejected:
        answer = messages.Rejected(rejected.path.name, rejected.fault, rejected.detail)
    except (PositionerError, OSError) as error:
        answer = messages.Refused(str(error))
    sys.stdout.buffer.write(messages.encode(answer))


if __name__ == "__main__":
    main()
