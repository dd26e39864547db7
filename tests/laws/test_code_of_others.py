"""Code that a configuration names: who runs it, as whom, and what it takes with it when it fails."""

from __future__ import annotations

import asyncio
import gzip
import os
import signal
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from virtual_shell import VirtualShell

from positioner.cli.main import main
from positioner.config.reader import load_config
from positioner.errors import ConfigurationError, ExitCode
from positioner.inputs import plug_in
from positioner.inputs.plug_in import Kind, changeable_by_others, loaded, problem_of
from positioner.laws.law import Observation
from positioner.laws.outside import OutsideLaw, OutsideLawError
from positioner.valve.state import StemState
from positioner.valve.stiction import StictionTable

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
LOG = ROOT / "tests" / "logs" / "nmpc.log.gz"
EVIL = """from pathlib import Path
Path({marker!r}).touch()
class L:
    def __init__(self, parts):
        pass
    def begin(self, measured_m):
        return None
    def decide(self, memory, stem, observation, table):
        return memory, 12.0
"""


@pytest.fixture
def received(tmp_path: Path) -> tuple[Path, Path]:
    """Return a folder as a stranger might send it, with a configuration and a log, and what its code would touch."""
    marker = tmp_path / "it-ran"
    folder = tmp_path / "received"
    folder.mkdir()
    (folder / "evil.py").write_text(EVIL.format(marker=str(marker)), encoding="utf-8")
    valve = LOG.with_name("nmpc.toml").read_text(encoding="utf-8").replace('law = "nmpc"', 'law = "evil.py:L"')
    valve = valve.replace('interface = "socketcan"\nchannel = "can0"', 'interface = "virtual"\nchannel = "none"')
    (folder / "valve.toml").write_text(valve, encoding="utf-8")
    assert load_config(folder / "valve.toml").control.law == f"{folder}/evil.py:L"
    (folder / "bus.log").write_bytes(gzip.decompress(LOG.read_bytes()))
    return folder, marker


READS = (
    ("check", "valve.toml"),
    ("check", "valve.toml", "--json"),
    ("check", "valve.toml", "--markdown"),
    ("report", "--config", "valve.toml", "--state", "state"),
    ("report", "--config", "valve.toml", "--state", "state", "--from", "bus.log"),
    ("explain", "bus.log", "--config", "valve.toml"),
    ("explain", "bus.log", "--config", "valve.toml", "--json"),
    ("diagnose", "bus.log", "--config", "valve.toml"),
    ("health", "--config", "valve.toml", "--state", "state"),
    ("health", "--config", "valve.toml", "--state", "state", "--from", "bus.log"),
    ("doctor", "--config", "valve.toml", "--state", "state"),
    ("reach", "--config", "valve.toml"),
    ("export", "bus.log", "--config", "valve.toml", "--to", "csv"),
    ("identify", "--config", "valve.toml", "--from", "bus.log"),
    ("signature", "--config", "valve.toml", "--from", "bus.log"),
    ("table", "dump", "--config", "valve.toml"),
)


@pytest.mark.parametrize("words", READS, ids=" ".join)
def test_no_command_that_only_reads_runs_code_that_a_configuration_names(
    words: tuple[str, ...], received: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, marker = received
    monkeypatch.chdir(folder)
    monkeypatch.setenv("XDG_STATE_HOME", str(folder / "home"))
    main(list(words))
    assert not marker.exists()


def test_replay_plays_the_law_and_so_runs_its_code(
    received: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, marker = received
    monkeypatch.chdir(folder)
    main(["replay", "bus.log", "--config", "valve.toml"])
    assert marker.exists()


def test_check_says_in_one_line_that_the_law_is_a_plug_in_that_was_not_loaded(
    received: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = received
    assert main(["check", str(folder / "valve.toml")]) == ExitCode.OK
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("law from outside")]
    assert f"{folder}/evil.py:L is a plug-in, from outside of this package, and was not loaded here" in line


def test_commands_that_need_the_law_and_may_not_load_it_say_so_in_one_line(
    received: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = received
    monkeypatch.chdir(folder)
    for words in (["explain", "bus.log"], ["health", "--from", "bus.log"], ["report", "--from", "bus.log"]):
        assert main([*words, "--config", "valve.toml"]) == ExitCode.CONFIG
        (line,) = capsys.readouterr().err.splitlines()
        assert "is a plug-in, and this command runs no code that a configuration names" in line
        assert "`positioner replay` does" in line


def test_the_doctor_says_that_it_did_not_measure_a_plug_in(
    received: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, _ = received
    monkeypatch.chdir(folder)
    main(["doctor", "--config", "valve.toml", "--state", "state", "--json"])
    assert "is a plug-in, and the doctor runs no code of others" in capsys.readouterr().out


def closed(folder: Path) -> Path:
    """Return a law of this user in a folder that nobody else may write."""
    folder.chmod(0o755)
    law = folder / "law.py"
    law.write_text("import beside\nL = beside.L\n", encoding="utf-8")
    (folder / "beside.py").write_text("L = 3\n", encoding="utf-8")
    for each in (law, folder / "beside.py"):
        each.chmod(0o644)
    return law


def test_code_that_others_could_change_is_found_at_each_step_of_its_way(tmp_path: Path) -> None:
    law, user = closed(tmp_path), os.getuid()
    if user:
        pytest.skip("the folders above the test's own belong to root")
    assert changeable_by_others(law, user) is None
    for place in (law, tmp_path / "beside.py", tmp_path, tmp_path.parent):
        mode = stat.S_IMODE(place.stat().st_mode)
        for more in (0o020, 0o002):
            place.chmod(mode | more)
            assert changeable_by_others(law, user) == f"{place} can be written by others"
            place.chmod(mode)
    for sticky, expected in ((tmp_path.parent, None), (tmp_path, f"{tmp_path} can be written by others")):
        mode = stat.S_IMODE(sticky.stat().st_mode)
        sticky.chmod(0o1777)  # as /tmp: nobody replaces what is another's, and everybody adds files
        assert changeable_by_others(law, user) == expected
        sticky.chmod(mode)
    link = tmp_path / "elsewhere"
    link.mkdir()
    (link / "law.py").symlink_to(law)
    assert changeable_by_others(link / "law.py", user) is None
    tmp_path.chmod(0o777)
    assert changeable_by_others(link / "law.py", user) is not None
    tmp_path.chmod(0o755)


def test_code_of_another_user_is_found(tmp_path: Path) -> None:
    law = closed(tmp_path)
    assert changeable_by_others(law, os.getuid() + 1) == f"{law} belongs to user {os.getuid()}"


def test_as_root_only_code_that_root_alone_can_change_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    law = tmp_path / "law.py"
    law.write_text(EVIL.format(marker=str(tmp_path / "it-ran")), encoding="utf-8")
    law.chmod(0o666)
    monkeypatch.setattr(os, "geteuid", lambda: 0)
    with pytest.raises(ConfigurationError, match="as root only code that root alone can change is run, and") as caught:
        loaded(Kind.LAW, f"{law}:L")
    assert len(str(caught.value).splitlines()) == 1
    assert not (tmp_path / "it-ran").exists()
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert loaded(Kind.LAW, f"{law}:L").__name__ == "L"


@pytest.mark.parametrize("kind", ["zeros", "pipe", "nested", "large"])
def test_a_law_that_is_no_file_of_code_is_refused_soon(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "law.py"
    if kind == "zeros":
        path.symlink_to("/dev/zero")
    elif kind == "pipe":
        os.mkfifo(path)
    else:
        path.write_text("L = " + ("(" * 5000 if kind == "nested" else "0" * (1 << 20)), encoding="utf-8")
    told = {"zeros": "is no plain file", "pipe": "is no plain file", "large": "is larger than 1 MiB: no law is"}
    assert told.get(kind, "too many nested parentheses") in str(problem_of(Kind.LAW, f"{path}:L", ()))


RAISES = (
    ("raise SystemExit(0)", "SystemExit: 0"),
    ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    ("import asyncio; raise asyncio.CancelledError('x')", "CancelledError: x"),
    ("raise GeneratorExit", "GeneratorExit"),
    ("raise type('E', (BaseException,), {'__str__': lambda self: 1 / 0})", "E: its text cannot be had"),
    ("return memory, type('N', (), {'__float__': lambda self: exit(3)})()", "SystemExit: 3"),
)


@pytest.mark.parametrize(("body", "expected"), RAISES, ids=[expected for _, expected in RAISES])
def test_what_a_law_raises_in_a_daemon_is_an_error_of_that_law_alone(
    body: str, expected: str, tmp_path: Path, daemons_own_handler: None
) -> None:
    del daemons_own_handler
    law = f"""class L:
    def __init__(self, parts): pass
    def begin(self, measured_m): return None
    def decide(self, memory, stem, observation, table):
        {body}
"""
    (tmp_path / "own.py").write_text(law, encoding="utf-8")
    with VirtualShell(tmp_path, control={"law": "own.py:L"}) as shell:
        shell.arm()
        before = len(shell.world.sent)
        shell.cycle_for(0.5)
        assert len(shell.world.sent) > before  # the guard goes on
        assert any(f"OutsideLawError: {expected}" in line for line in shell.logged("own.py:L failed"))


@pytest.fixture
def daemons_own_handler() -> Iterator[None]:
    """Let SIGINT have a handler of the program's own, as `Daemon.run` gives it."""
    before = signal.signal(signal.SIGINT, lambda *_: None)
    yield
    signal.signal(signal.SIGINT, before)


def test_a_persons_interrupt_passes_through_a_law_where_python_handles_it() -> None:
    class Hears:
        def begin(self, measured_m: float) -> Any:
            del measured_m
            signal.raise_signal(signal.SIGINT)

        def decide(self, *_: Any) -> Any:
            raise asyncio.CancelledError

    law = OutsideLaw("own", Hears(), "", 4.0, 20.0)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            law.begin(0.0)
        assert plug_in.is_interrupt(KeyboardInterrupt())
        assert not plug_in.is_interrupt(SystemExit())
    finally:
        signal.signal(signal.SIGINT, before)
    stem = StemState(position_m=0.0, velocity_m_per_s=0.0, stuck=True, direction=1.0)
    with pytest.raises(OutsideLawError, match="CancelledError"):
        law.decide(None, stem, Observation(0.0, 12.0, 0.001, 0.0, 0.0), StictionTable())


def test_a_law_that_ends_the_program_where_it_is_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text("def L(parts):\n    raise SystemExit(0)\n", encoding="utf-8")
    scenario = tmp_path / "short.toml"
    scenario.write_text('name = "s"\ntitle = "s"\nlaw = "own.py:L"\nsetpoints_mm = [80.0]\ndwell_s = 0.1\n', "utf-8")
    with pytest.raises(ConfigurationError, match=r"own.py:L: line 2: law: cannot be made: SystemExit: 0"):
        VirtualShell(tmp_path, control={"law": "own.py:L"}).__enter__()
