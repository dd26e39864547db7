"""Notifications to the service manager about the daemon: systemd's protocol, sd_notify(3). Shell."""

from __future__ import annotations

import contextlib
import os
import socket

from positioner.errors import in_one_line


class Notifier:
    """Sends notifications where $NOTIFY_SOCKET asks for them; does nothing elsewhere."""

    def __init__(self) -> None:
        """Connect to the service manager, if there is one."""
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)
            self._address = "\0" + address[1:] if address.startswith("@") else address

    def send(self, **fields: str) -> None:
        """Send the fields, for example `send(READY="1", STATUS="loop closed")`; a full socket drops them."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                # a line is a field: a value has one line, whoever has named what stands in it
                text = "\n".join(f"{key}={in_one_line(value)}" for key, value in fields.items())
                self._socket.sendto(text.encode(), self._address)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None
