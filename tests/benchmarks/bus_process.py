"""The other process on a bus: the daemon itself, or an echo that answers every position frame at once.

    python -m benchmarks.bus_process daemon|echo CONFIG SETPOINT_EVERY [SOCKET]

It joins the bus of the configuration or, where a SOCKET is given, the process that listens there.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.paired_bus import joined
from positioner.bus.port import BusPort, Ports
from positioner.config.reader import load_config
from positioner.machine.journal import set_up
from positioner.machine.notify import Notifier
from positioner.runtime.daemon import Daemon
from positioner.runtime.session import RunOptions
from positioner.wire.messages import CanFrame, CurrentCommand, StemPosition

WAITING = "waiting for position frames"
"""What both report once they are on the bus."""


def main() -> None:
    """Answer until SIGTERM."""
    kind, path, setpoint_every, *end = sys.argv[1:]
    configuration = load_config(Path(path))
    ports = Ports(open_bus=joined(end[0])) if end else Ports()
    if kind == "daemon":
        set_up(verbose=False)
        options = RunOptions(lockstep=True, setpoint_every=int(setpoint_every))
        sys.exit(Daemon((configuration,), options, ports).run())
    codec = configuration.make_codec()
    identifier, extended = codec.identifier(CurrentCommand)
    port = BusPort(configuration.bus, [codec.identifier(StemPosition)], ports=ports)
    port.open()
    Notifier().send(STATUS=WAITING)
    while True:
        for frame in port.receive(1.0):
            port.send(CanFrame(identifier, frame.data, extended))


if __name__ == "__main__":
    main()
