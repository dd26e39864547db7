"""Opening a bus: which settings reach python-can, and which refusals are for ever."""

from __future__ import annotations

import errno
import gc
import sys
import time
import zlib
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import can
import pytest
from can.interfaces import BACKENDS
from daemon_helpers import own_address

from positioner.bus.address import BusAddress, embedded_address, parse_address
from positioner.bus.events import BusBack, BusNotOpened
from positioner.bus.opening import open_bus
from positioner.bus.port import BusPort
from positioner.cli.main import main
from positioner.config.reader import parse_config
from positioner.errors import BusError, BusUnusableError, ConfigurationError, ExitCode
from positioner.wire.messages import CanFrame

if TYPE_CHECKING:
    from collections.abc import Callable

    from positioner.bus.events import BusEvent

HOSTILE = "[default]\ninterface = socketcan\nreceive_own_messages = True\nhop_limit = 9\nbitrate = 125000\n"


class Adapter(can.BusABC):
    """An adapter that notes the arguments with which it is opened, or fails as the test demands."""

    seen: tuple[Any, dict[str, Any]] = (None, {})
    failure: Exception | None = None

    def __init__(self, channel: Any, **options: Any) -> None:
        if Adapter.failure is not None:
            raise Adapter.failure
        Adapter.seen = channel, options
        super().__init__(channel)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        del msg, timeout

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        del timeout
        return None, False


@pytest.fixture
def adapter(monkeypatch: pytest.MonkeyPatch) -> type[Adapter]:
    """Put the adapter in the place of the interfaces `kvaser` and `slcan`."""
    module = ModuleType("adapter_of_the_test")
    module.__dict__["Adapter"] = Adapter
    monkeypatch.setitem(sys.modules, module.__name__, module)
    for interface in ("kvaser", "slcan"):
        monkeypatch.setitem(BACKENDS, interface, (module.__name__, "Adapter"))
    monkeypatch.setattr(Adapter, "failure", None)
    return Adapter


@pytest.mark.parametrize(
    ("text", "channel", "options"),
    [
        ("kvaser:0", 0, {}),
        ("kvaser:1,bitrate=500000,accept_virtual=false", 1, {"bitrate": 500000, "accept_virtual": False}),
        ("slcan:/dev/ttyUSB0@115200", "/dev/ttyUSB0@115200", {}),
        ("slcan:/dev/ttyUSB0,bitrate=250000,sleep_after_open=0.5", "/dev/ttyUSB0",
         {"bitrate": 250000, "sleep_after_open": 0.5}),
    ],
)  # fmt: skip
@pytest.mark.parametrize("from_file", [False, True])
def test_channels_and_options_reach_the_interface_as_numbers_and_words(
    text: str, channel: Any, options: dict[str, Any], *, from_file: bool, adapter: type[Adapter]
) -> None:
    address = parse_address(text)
    if from_file:
        shown = f"{channel}" if isinstance(channel, int) else f'"{channel}"'
        lines = [f"{key} = {str(value).lower()}" for key, value in options.items()]
        table = f'[bus]\ninterface = "{address.interface}"\nchannel = {shown}\n[bus.options]\n' + "\n".join(lines)
        assert parse_config(f'[valve]\nid = "v"\npreset = "paper"\n{table}\n', "valve.toml", None).bus == address  # type: ignore[arg-type]
    assert parse_address(str(address)) == address
    open_bus(address, ()).shutdown()
    assert adapter.seen == (channel, options)


@pytest.mark.parametrize(
    ("failure", "kind"),
    [
        (can.CanInitializationError("no such device"), BusError),
        (OSError(errno.ENODEV, "No such device"), BusError),
        (can.CanInterfaceNotImplementedError("The serial module is not installed"), BusUnusableError),
        (NameError("name 'canGetNumberOfChannels' is not defined"), BusUnusableError),
        (ImportError("Please install python-ics"), BusUnusableError),
        (OSError("pcanbasic library not found."), BusUnusableError),
        (TypeError("Adapter.__init__() missing 1 required positional argument: 'host'"), BusUnusableError),
        (ValueError("Must specify a valid\n bitrate"), BusUnusableError),
    ],
)
def test_a_missing_device_may_come_and_a_missing_driver_does_not(
    failure: Exception, kind: type[BusError], adapter: type[Adapter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapter, "failure", failure)
    with pytest.raises(BusError) as caught:
        BusPort(BusAddress(interface="kvaser", channel="0")).open()
    assert type(caught.value) is kind
    assert len(str(caught.value).splitlines()) == 1
    assert str(caught.value).startswith("bus kvaser:0 cannot be ")
    wanted = ExitCode.CONFIG if kind is BusUnusableError else ExitCode.UNAVAILABLE
    assert caught.value.exit_code is wanted


@pytest.mark.parametrize(
    ("interface", "mend"), [("kvaser", "see https://"), ("slcan", "pip install 'python-can[serial]'")]
)
def test_a_missing_driver_is_reported_with_where_to_get_it(
    interface: str, mend: str, adapter: type[Adapter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapter, "failure", can.CanInterfaceNotImplementedError("not installed"))
    with pytest.raises(BusUnusableError) as caught:
        BusPort(BusAddress(interface=interface, channel="0")).open()
    assert mend in str(caught.value)


def test_a_bus_that_was_there_once_is_waited_for_whatever_the_error(
    adapter: type[Adapter], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(time, "sleep", lambda _seconds: None)
    events: list[BusEvent] = []
    port = BusPort(BusAddress(interface="kvaser", channel="0"), report=events.append)
    port.receive(0.0)
    assert port.is_open
    port.close()
    monkeypatch.setattr(adapter, "failure", NameError("the driver is being replaced"))
    now_s[0] += 1.0
    assert port.receive(0.0) == ()
    monkeypatch.setattr(adapter, "failure", None)
    now_s[0] += 1.0
    port.receive(0.0)
    assert port.is_open
    port.close()
    lost, back = events
    assert isinstance(lost, BusNotOpened)
    assert "being replaced" in str(lost)
    assert back == BusBack(port.address)


@pytest.fixture
def _hostile_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("can.conf", ".can", ".canrc"):
        (tmp_path / name).write_text(HOSTILE, encoding="utf-8")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("CAN_CONFIG", '{"receive_own_messages": true}')
    monkeypatch.setenv("CAN_BITRATE", "125000")


@pytest.mark.usefixtures("_hostile_home")
def test_files_and_environment_of_python_can_are_ignored(tmp_path: Path, adapter: type[Adapter]) -> None:
    open_bus(BusAddress(interface="kvaser", channel="0"), ()).shutdown()
    assert adapter.seen == (0, {})
    port = BusPort(BusAddress(interface="virtual", channel=str(tmp_path)))
    port.open()
    assert port.send(CanFrame(0x100, bytes(8)))
    assert port.receive(0.0) == ()
    port.close()


@pytest.mark.bus
@pytest.mark.usefixtures("_hostile_home")
def test_the_embedded_bus_opens_whatever_the_files_of_python_can_contain() -> None:
    port = BusPort(own_address())
    port.open()
    assert port.is_open
    port.close()


def absent(interface: str, channel: str) -> Callable[[], None]:
    """Return a function that tries once to open a bus that is not there."""
    port = BusPort(BusAddress(interface=interface, channel=channel))
    port._was_open = True

    def attempt() -> None:
        port._next_try_s = 0.0
        assert not port.try_open()

    return attempt


@pytest.mark.parametrize(
    ("interface", "channel"), [("socketcan", "vcan77"), ("kvaser", "0"), ("udp_multicast", "ff11::1")]
)
def test_a_thousand_tries_to_open_a_bus_leave_no_garbage(
    interface: str, channel: str, adapter: type[Adapter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapter, "failure", can.CanInitializationError("no such device"))
    if interface == "udp_multicast":
        monkeypatch.setattr("socket.getaddrinfo", lambda *_args, **_more: [])
    attempt = absent(interface, channel)
    attempt()
    gc.collect()
    gc.disable()
    try:
        for _ in range(1000):
            attempt()
        assert gc.collect() == 0
    finally:
        gc.enable()


MISTAKES = [
    ('interface = "scketcan"', 5, "bus.interface = 'scketcan': is unknown; did you mean 'socketcan'?"),
    ('interface = "zzz"', 5, "bus.interface = 'zzz': is none of embedded, kvaser, "),
    ('channel = "a-name-too-long-for-it"', 5, "must have 1 to 15 characters"),
    ('interface = "udp_multicast"\nchannel = "10.0.0.1"', 6, "bus.channel = '10.0.0.1': is no multicast group"),
    ('interface = "kvaser"\noptions.receive_own_messages = true', 6, "take its own commands for another controller's"),
    ('interface = "kvaser"\noptions.channel = 3', 6, "bus.options.channel = 3: is no option"),
    ("options.bitrate = 500000", 5, "bus.options.bitrate = 500000: is set on the interface itself: sudo ip link set"),
    ('interface = "udp_multicast"\nchannel = "ff11::1"\noptions.hop_limit = 3', 7, "is no option of the embedded bus"),
    ('interface = "kvaser"\noptions.bitrate = [1]', 6, "bus.options.bitrate"),
]


@pytest.mark.parametrize(("table", "line", "expected"), MISTAKES)
def test_a_bus_that_can_never_be_opened_is_a_mistake_of_the_configuration(table: str, line: int, expected: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        parse_config(f'[valve]\nid = "v"\npreset = "paper"\n[bus]\n{table}\n', "valve.toml", Path())
    assert f"valve.toml: line {line}: " in str(caught.value)
    assert expected in str(caught.value)


@pytest.mark.parametrize("command", [["check", "{valve}"], ["run", "--config", "{valve}"]])
def test_check_and_run_know_no_scketcan(command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text('[valve]\nid = "v"\npreset = "paper"\n[bus]\ninterface = "scketcan"\n', encoding="utf-8")
    assert main([word.format(valve=path) for word in command]) == ExitCode.CONFIG
    (line,) = capsys.readouterr().err.splitlines()
    assert "did you mean 'socketcan'?" in line


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("scketcan:can0", "did you mean 'socketcan'?"),
        ("socketcan:can0,bitrate=500000", "is set on the interface itself"),
        ("udp_multicast:localhost", "is no multicast group"),
        ("kvaser:0=1", "INTERFACE:CHANNEL"),
    ],
)
def test_an_address_of_no_bus_is_refused(text: str, expected: str) -> None:
    with pytest.raises(BusUnusableError) as caught:
        parse_address(text)
    assert expected in str(caught.value)


def test_an_embedded_bus_with_a_name_is_not_that_of_a_bench() -> None:
    address = parse_address("embedded:fv101")
    assert address == BusAddress(interface="embedded", channel="fv101")
    assert address.is_embedded
    assert parse_address(str(address)) == address
    assert address != parse_address("embedded:fv102")
    assert address.channel != embedded_address(zlib.crc32(b"fv101")).channel
    table = '[bus]\ninterface = "embedded"\nchannel = "fv101"\n'
    assert parse_config(f'[valve]\nid = "v"\npreset = "paper"\n{table}', "valve.toml", Path()).bus == address


@pytest.mark.bus
def test_run_ends_with_one_line_where_the_driver_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], adapter: type[Adapter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(adapter, "failure", NameError("name 'canGetNumberOfChannels' is not defined"))
    path = tmp_path / "valve.toml"
    path.write_text(
        f'[valve]\nid = "v"\npreset = "paper"\n[state]\ndirectory = "{tmp_path / "state"}"\n', encoding="utf-8"
    )
    assert main(["run", "--config", str(path), "--bus", "kvaser:0"]) == ExitCode.CONFIG
    assert (
        capsys.readouterr()
        .err.splitlines()[-1]
        .startswith(
            "positioner: bus kvaser:0 cannot be used on this machine: name 'canGetNumberOfChannels' is not defined;"
        )
    )
