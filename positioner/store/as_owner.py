"""Root's access to a state directory of another user, through a process that becomes that user.

The owner decides which files are in the directory, so root opens none of them. The process that opens them has the
owner's rights, and the directory is its root directory. Its answer is checked like any other message.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from positioner.errors import PositionerError, StateError
from positioner.store import messages
from positioner.store.commands import on_files
from positioner.store.file_check import TableRejectedError
from positioner.store.interpreter import command, environment

_ANSWER_S = 30.0


def own_directory(directory: Path) -> Path:
    """Return the directory, made where it is missing.

    Raises:
        StateError: it cannot be made, or belongs to another user.
    """
    try:
        directory.mkdir(mode=0o750, parents=True, exist_ok=True)
    except OSError as error:
        message = f"{directory}: the state directory cannot be made: {error.strerror}; choose another or make it"
        raise StateError(message) from error
    if is_needed(directory):
        owner = directory.stat().st_uid
        message = f"{directory}: belongs to user {owner}; start the positioner as that user, or choose another"
        raise StateError(message)
    return directory


def is_needed(directory: Path) -> bool:
    """Return whether this process is root's and the directory belongs to another user."""
    return os.geteuid() == 0 and directory.stat().st_uid != 0


def ask(directory: Path, request: messages.Request) -> messages.Message:
    """Return the answer to `request` that the owner of the directory gets.

    Raises:
        StateError: no answer came; nothing was changed.
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
        case messages.Refused(reason):
            return messages.Refused(f"{directory}: {reason}")
        case messages.Done(str(backup)):
            return messages.Done(str(directory / backup.lstrip("/")))
    return answer


def _become_owner(descriptor: int) -> None:
    """Give up everything but the directory and its owner's rights in it."""
    status = os.fstat(descriptor)
    os.fchdir(descriptor)
    os.chroot(".")
    os.setgroups([])
    os.setresgid(status.st_gid, status.st_gid, status.st_gid)
    os.setresuid(status.st_uid, status.st_uid, status.st_uid)


def main() -> None:
    """Answer the request on the standard input as the owner of the directory whose descriptor is the argument."""
    answer: messages.Answer
    try:
        request = messages.decode(sys.stdin.buffer.read())
        _become_owner(int(sys.argv[1]))
        answer = on_files(Path("/"), request)
    except TableRejectedError as rejected:
        answer = messages.Rejected(rejected.path.name, rejected.fault, rejected.detail)
    except (PositionerError, OSError) as error:
        answer = messages.Refused(str(error))
    sys.stdout.buffer.write(messages.encode(answer))


if __name__ == "__main__":
    main()
