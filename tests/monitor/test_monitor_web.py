"""The page: who gets it, what it is sent, and who is refused."""

from __future__ import annotations

import http.client
import json
import shutil
import socket
import subprocess
import threading
from contextlib import closing, contextmanager
from importlib import resources
from typing import TYPE_CHECKING, Any

import pytest
from monitor_helpers import RecordingBus, configured, frames_of, live_source
from replay_helpers import scenario, write_bench_log

from positioner.cli.main import main
from positioner.config.reader import load_valves
from positioner.monitor.page_data import Stream, setup_of
from positioner.monitor.recorded import RecordedSource
from positioner.monitor.web import MOST_STREAMS, PageServer

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from positioner.monitor.source import Source

pytestmark = pytest.mark.bus


@contextmanager
def served(source: Source) -> Iterator[PageServer]:
    """Yield the server of the page of a source."""
    source.start()
    server = PageServer(source, 0)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield server
    finally:
        server.close()
        source.close()


def asked(server: PageServer, method: str, path: str, body: str = "", **headers: str) -> http.client.HTTPResponse:
    """Return the answer to a request, not read yet."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_address[1], timeout=300.0)
    names = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, body or None, names)
    return connection.getresponse()


def answer_to(server: PageServer, line: str) -> int:
    """Return the status of the answer to a request that a library for browsers would not send."""
    with socket.create_connection(("127.0.0.1", server.server_address[1]), timeout=300.0) as connection:
        host = server.address.removeprefix("http://").rstrip("/")
        connection.sendall(f"{line}\r\nHost: {host}\r\n\r\n".encode())
        return int(connection.makefile().readline().split()[1])


def told(response: http.client.HTTPResponse) -> dict[str, Any]:
    """Return the next state of a stream."""
    line = response.readline()
    assert line.startswith(b"data: ")
    assert response.readline() == b"\n"
    state: dict[str, Any] = json.loads(line[6:])
    return state


def test_a_browser_gets_one_page_and_the_states_of_a_valve(tmp_path: Path) -> None:
    bus, configurations = RecordingBus(), configured(tmp_path)
    source = live_source(configurations, bus)
    with served(source) as server:
        assert server.server_address[0] == "127.0.0.1"
        page = asked(server, "GET", "/")
        text = page.read().decode()
        assert page.status == 200
        assert '"valves": ["FV-101"]' in text
        assert "@NONCE@" not in text
        policy = page.headers["Content-Security-Policy"]
        assert policy.startswith("default-src 'none'; connect-src 'self'; script-src 'nonce-")
        with closing(asked(server, "GET", "/events?valve=FV-101")) as stream:
            assert told(stream)["view"]["position_m"] is None
            bus.bring(frames_of(configurations[0].make_codec(), 3.0))
            while (state := told(stream))["view"]["health"] is None:
                pass
        assert state["view"]["setpoint_m"] == pytest.approx(0.062, abs=1e-5)
        assert state["view"]["error_m"] == state["view"]["position_m"] - state["view"]["setpoint_m"]
        assert state["line"] == "listening on virtual:can0"
    assert bus.sent == []


STUBS = """
const calls = [];
const stub_pen = new Proxy({}, { get: (_, name) => (...given) => { calls.push([name, ...given]); }, set: () => true });
const stubs = { textContent: "", value: "10", style: {}, clientWidth: 700, clientHeight: 400, add() {} };
globalThis.window = {};
globalThis.Option = globalThis.EventSource = class {};
globalThis.document = { getElementById: id =>
  id === "setup" ? { textContent: SETUP } : { ...stubs, getContext: () => stub_pen } };
"""
SHOWS = "\nshow(TOLD); console.log(JSON.stringify(calls));"


def drawn_by_the_page(state: dict[str, Any], setup: dict[str, Any]) -> list[list[Any]]:
    """Return what the page's script calls on its canvas, 700 x 400 pixels over 10 s, once it was told a state."""
    page = (resources.files("positioner.monitor") / "page.html").read_text(encoding="utf-8")
    script = page.rpartition('<script nonce="@NONCE@">')[2].partition("</script>")[0]
    stubs = STUBS.replace("SETUP", json.dumps(json.dumps(setup)))
    node = shutil.which("node")
    if node is None:
        pytest.skip("would check the labels and gaps that the page draws: needs node")
    text = stubs + script + SHOWS.replace("TOLD", json.dumps(state))
    calls: list[list[Any]] = json.loads(
        subprocess.run([node, "-"], input=text.encode(), capture_output=True, check=True).stdout
    )
    return calls


def test_the_page_draws_round_labels_and_no_line_through_a_gap(tmp_path: Path) -> None:
    configurations = configured(tmp_path)
    source = live_source(configurations, RecordingBus())
    model, codec = source.models["FV-101"], configurations[0].make_codec()
    for frame in frames_of(codec, 9.0):
        if not 4_000_000_000 < frame.received_ns < 4_300_000_000:
            model.add(frame, frame.received_ns)
    state = Stream(source, "FV-101").next()
    assert state["view"]["late_s"] == 0.02
    calls = drawn_by_the_page(state | {"bin": 900}, setup_of(source, "FV-101"))
    labels = [str(call[1]) for call in calls if call[0] == "fillText"]
    assert labels == [
        *("60", "61", "62", "63", "64", "position, setpoint, mm", "11.9", "12.0", "12.1", "current, mA"),
        *("-10 s", "-7.5 s", "-5 s", "-2.5 s", "0 s"),
    ]
    begins = [call[1] for call in calls if call[0] == "moveTo" and call[1] > 56.0]
    bins = [round((x - 56.0) / 636.0 * 1000.0) - 100 for x in begins]
    assert sorted(bins) == [0, 0, 0, *(first_after(state, part) for part in (1, 3))], "a setpoint goes on for 0.5 s"


def first_after(state: dict[str, Any], part: int) -> int:
    """Return the first bin behind the gap that has a value."""
    return int(next(each[0] for each in state["bins"] if each[0] > 401 and each[part] is not None))


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/", {"Host": "valve.attacker.example"}, 421),
        ("/events", {"Host": "valve.attacker.example:8642"}, 421),
        ("/", {"Host": "127.0.0.1:1"}, 421),
        ("/etc/passwd", {}, 404),
        ("/events?valve=FV-999", {}, 404),
    ],
)
def test_another_name_or_place_gets_nothing(tmp_path: Path, path: str, headers: dict[str, str], status: int) -> None:
    with served(live_source(configured(tmp_path), RecordingBus())) as server:
        assert asked(server, "GET", path, **headers).status == status
        port = server.server_address[1]
        assert asked(server, "GET", "/", Host=f"localhost:{port}").status == 200


def test_a_log_is_played_by_the_own_page_alone(tmp_path: Path) -> None:
    log, config = write_bench_log(tmp_path, scenario(seconds=0.3))
    source = RecordedSource(load_valves(config), log)
    source.toggle()
    with served(source) as server:
        own = {"Origin": server.address.rstrip("/"), "Content_Type": "application/json"}
        seek = json.dumps({"do": "seek", "value": 0.2})
        for wrong in (
            own | {"Origin": "http://attacker.example"},
            own | {"Content_Type": "text/plain"},
            {"Content_Type": "application/json"},
        ):
            assert asked(server, "POST", "/play", seek, **wrong).status == 403
        assert asked(server, "POST", "/play", seek, **own, Host="attacker.example").status == 421
        for nonsense in ("[", "{}", '{"do": "arm"}', '{"do": "seek", "value": "x"}'):
            assert asked(server, "POST", "/play", nonsense, **own).status == 400
        for odd in ("[" * 1000, '{"do": []}', '{"do": "seek", "value": [1]}', "\x1b", "{" * 1024, "1" * 1024, ""):
            assert asked(server, "POST", "/play", odd, **own).status == 400
        for most in (f'{{"do": "seek", "value": 1{"0" * 900}}}', '{"do": "seek", "value": 1e999}'):
            assert asked(server, "POST", "/play", most, **own).status in {204, 400}
        for origin in (
            "http://[",
            "null",
            "",
            "http://[::1",
            "file://",
            f"{own['Origin']}.example",
            f"{own['Origin']}/x",
        ):
            assert asked(server, "POST", "/play", seek, **own | {"Origin": origin}).status == 403
        for length in ("9" * 5000, "-1", "1e3", "\u00b2", "1025"):
            lied = own | {"Content_Length": length}
            assert asked(server, "POST", "/play", "", **lied).status == 403
        for path in ("//[", "/[::1", "/%00", "/events?valve=%1b[2J", "http://[/"):
            assert answer_to(server, f"GET {path} HTTP/1.0") in {400, 404}
        for value in ("NaN", "Infinity", "-Infinity"):
            assert asked(server, "POST", "/play", f'{{"do": "seek", "value": {value}}}', **own).status == 204
        assert source.failure is None
        assert source.progress.time_s == 0.0
        assert asked(server, "POST", "/play", seek, **own).status == 204
        with closing(asked(server, "GET", "/events")) as stream:
            while told(stream)["progress"]["time_s"] != pytest.approx(0.2):
                pass
        asked(server, "POST", "/play", json.dumps({"do": "speed", "value": 3}), **own)
        assert source.progress.speed == 3.0


def test_a_browser_that_reads_nothing_holds_up_no_other_and_there_is_a_limit(tmp_path: Path) -> None:
    bus, configurations = RecordingBus(), configured(tmp_path)
    source = live_source(configurations, bus)
    with served(source) as server:
        port = server.server_address[1]
        slow = []
        for _ in range(MOST_STREAMS - 1):
            connection = socket.create_connection(("127.0.0.1", port), timeout=300.0)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)
            connection.sendall(f"GET /events HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            assert connection.recv(1)
            slow.append(connection)
        with closing(asked(server, "GET", "/events")) as stream:
            bus.bring(frames_of(configurations[0].make_codec(), 3.0))
            while told(stream)["view"]["health"] is None:
                pass
            assert asked(server, "GET", "/events").status == 503
        for connection in slow:
            connection.close()
    assert bus.brought.empty()


def test_a_stream_sends_each_bin_until_it_is_full_and_all_again_after_a_step_back(tmp_path: Path) -> None:
    log, config = write_bench_log(tmp_path, scenario(seconds=0.3))
    source = RecordedSource(load_valves(config), log)
    source._playback.playing = False

    def at(time_s: float) -> dict[str, Any]:
        source.seek(time_s)
        source._round()
        return stream.next()

    stream = Stream(source, "bench")
    first, second, back = at(0.105), at(0.205), at(0.05)
    assert [each[0] for each in first["bins"]] == list(range(11))
    assert [each[0] for each in second["bins"]] == list(range(10, 21))
    assert not second["reset"]
    assert back["reset"]
    assert [each[0] for each in back["bins"]] == list(range(6))


def test_a_port_that_is_taken_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    configured(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for wrong in (port, "-1", "70000"):
            assert main(["monitor", "--config", str(tmp_path / "valve.toml"), "--web", "--port", wrong]) == 2
            line = capsys.readouterr().err
            assert line.count("\n") == 1
            assert f"--port {wrong}: " in line
