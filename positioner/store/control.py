"""`control.sock`, through which the command line sends requests to the table writer and receives its answers."""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from typing import TYPE_CHECKING

from positioner.store.channel import Channel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from positioner.store import messages

NAME = "control.sock"
_WAITING_CLIENTS = 16
_MOST_CLIENTS = 64


def address(directory: int) -> str:
    """Return the socket's address under a directory's descriptor: its full path may exceed 107 bytes."""
    return f"/proc/self/fd/{directory}/{NAME}"


class ControlSocket:
    """The listening socket and its connections; `notices` has a line where the socket cannot be made."""

    def __init__(self, directory: int) -> None:
        self._directory = directory
        self._clients: set[Channel] = set()
        self._listening: socket.socket | None = None
        self.notices: tuple[str, ...] = ()
        try:
            self._listening = _listen(directory)
        except OSError as error:
            self.notices = (f"no {NAME}: {error.strerror}; `table reset` and `table import` need the daemon stopped",)

    def close(self) -> None:
        """Close all connections and remove the socket."""
        for client in self._clients:
            client.close()
        if self._listening:
            with suppress(OSError):
                os.unlink(NAME, dir_fd=self._directory)
            self._listening.close()

    def waiting(self) -> tuple[list[socket.socket | Channel], list[Channel]]:
        """Return what to wait on for reading and for writing."""
        listening = [self._listening] if self._listening else []
        return [*listening, *self._clients], [client for client in self._clients if client.pending]

    def serve(
        self, ready: Iterable[socket.socket | Channel], answer: Callable[[messages.Message], messages.Answer]
    ) -> None:
        """Accept connections, answer requests and close ended connections, without waiting."""
        for one in ready:
            if isinstance(one, Channel):
                for request in one.receive():
                    one.send(answer(request))
                one.flush()
            else:
                with suppress(OSError):  # the client may have gone again
                    self._accept(one.accept()[0])
        for client in [client for client in self._clients if client.ended]:
            self._clients.remove(client)
            client.close()

    def _accept(self, connection: socket.socket) -> None:
        if len(self._clients) < _MOST_CLIENTS:
            self._clients.add(Channel(connection))
        else:
            connection.close()  # so many clients are an attack; the daemon's samples come first


def _listen(directory: int) -> socket.socket:
    with suppress(FileNotFoundError):
        os.unlink(NAME, dir_fd=directory)  # left by a table writer that was killed: with the lock held no other runs
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    mask = os.umask(0o117)
    try:
        listening.bind(address(directory))
    except OSError:
        listening.close()
        raise
    finally:
        os.umask(mask)
    listening.listen(_WAITING_CLIENTS)
    listening.setblocking(False)
    return listening
