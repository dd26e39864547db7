"""`make install` and `make uninstall` below a DESTDIR: what they put there, what they take away, and what they leave.

The interpreter is a stand-in that makes an environment without fetching anything.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from building.completions import PLACES
from positioner.machine.completion import SHELLS

ROOT = Path(__file__).resolve().parents[2]
INTERPRETER = r"""#!/bin/sh
# python -m venv --clear DIRECTORY makes an environment, its python -m pip install notes what it was asked for
case "$1 $2 $3" in
"-m venv --clear")
    rm -rf "$4"
    mkdir -p "$4/bin"
    cp "$0" "$4/bin/python"
    printf 'home = /usr/bin\ncommand = python -m venv %s\n' "$4" > "$4/pyvenv.cfg"
    for program in positioner plant-emulator; do
        printf '#!%s/bin/python\n' "$4" > "$4/bin/$program"
        chmod 755 "$4/bin/$program"
    done ;;
"-m pip "*) echo "PYTHONPATH=$PYTHONPATH $*" >> "$(dirname "$0")/../asked" ;;
"-B -m documents.manual") mkdir -p "$4" && touch "$4/positioner.1" "$4/positioner-run.1" "$4/plant-emulator.1" ;;
"-P building/completions.py "*)
    for program in positioner plant-emulator; do
        for file in bash-completion/completions/NAME zsh/site-functions/_NAME fish/vendor_completions.d/NAME.fish; do
            mkdir -p "$3/$(dirname $file)"
            echo "for $program" > "$3/$(echo $file | sed "s/NAME/$program/")"
        done
    done ;;
"-c "*) echo "${BASE_PREFIX:-/usr}" ;;
esac
"""
PROGRAMS = ("positioner", "plant-emulator")
UNITS = {"positioner@.service", "plant-emulator@.service", "vcan0.service"}


@pytest.fixture
def interpreter(tmp_path: Path) -> Path:
    path = tmp_path / "python"
    path.write_text(INTERPRETER, encoding="utf-8")
    path.chmod(0o755)
    return path


def make(target: str, interpreter: Path, **variables: str | Path) -> subprocess.CompletedProcess[str]:
    given = [f"{name}={value}" for name, value in {"INSTALL_PYTHON": interpreter, **variables}.items()]
    clean = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("MAKE", "PREFIX", "DESTDIR", "PYTHONPATH"))
    }
    return subprocess.run(
        ["make", "--directory", str(ROOT), target, *given],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=clean,
    )


def files_below(place: Path) -> set[str]:
    return {str(path.relative_to(place)) for path in place.rglob("*") if path.is_symlink() or path.is_file()}


def test_make_is_there_to_be_tested() -> None:
    assert shutil.which("make"), "make is missing: sudo apt install make"


def test_everything_is_put_below_destdir_and_speaks_of_the_place_where_it_will_be(
    interpreter: Path, tmp_path: Path
) -> None:
    place = tmp_path / "root"
    done = make("install", interpreter, DESTDIR=place)
    assert done.returncode == 0, done.stderr
    examples = {path.name for path in (ROOT / "systemd" / "network").iterdir()} | {
        "bus.conf",
        "realtime.conf",
        "serial.conf",
    }
    assert files_below(place) == {
        *(f"opt/positioner/{name}" for name in ("pyvenv.cfg", "asked")),
        *(f"opt/positioner/bin/{name}" for name in ("python", "positioner", "plant-emulator")),
        *(f"opt/positioner/share/positioner/{name}" for name in examples),
        *(f"etc/systemd/system/{name}" for name in UNITS),
        "usr/local/bin/positioner",
        "usr/local/bin/plant-emulator",
        *(f"usr/local/share/man/man1/{name}.1" for name in ("positioner", "positioner-run", "plant-emulator")),
        *(f"usr/local/share/{PLACES[shell].format(program)}" for shell in SHELLS for program in PROGRAMS),
    }
    assert (place / "etc/positioner").is_dir()
    assert (place / "usr/local/bin/positioner").readlink() == Path("/opt/positioner/bin/positioner")
    for name in ("bin/positioner", "pyvenv.cfg"):
        text = (place / "opt/positioner" / name).read_text(encoding="utf-8")
        assert "/opt/positioner" in text
        assert str(place) not in text
    for name in UNITS:
        installed = place / "etc/systemd/system" / name
        assert installed.read_bytes() == (ROOT / "systemd" / name).read_bytes()
        assert installed.stat().st_mode & 0o777 == 0o644


def test_nothing_is_installed_but_what_the_lock_files_name_with_its_hash(interpreter: Path, tmp_path: Path) -> None:
    place = tmp_path / "root"
    assert make("install", interpreter, DESTDIR=place).returncode == 0
    tools = f"{place}/opt/positioner/build-tools"
    pip = "-m pip --quiet --disable-pip-version-check install"
    asked = (place / "opt/positioner/asked").read_text(encoding="utf-8").splitlines()
    assert asked == [
        f"PYTHONPATH= {pip} --target {tools} --require-hashes --requirement requirements/build.txt",
        f"PYTHONPATH= {pip} --require-hashes --requirement requirements/run.txt",
        # the package itself: from here, built with the locked tools
        f"PYTHONPATH={tools} {pip} --no-deps --no-index --no-build-isolation .",
        "PYTHONPATH= -m pip check",
    ]
    assert not Path(tools).exists()


def test_a_second_install_renews_the_first(interpreter: Path, tmp_path: Path) -> None:
    place = tmp_path / "root"
    for _ in range(2):
        assert make("install", interpreter, DESTDIR=place).returncode == 0
        assert not (place / "opt/positioner/bin/of-an-older-version").exists()
        (place / "opt/positioner/bin/of-an-older-version").write_text("")
    assert (place / "usr/local/bin/positioner").is_symlink()


def test_another_prefix_stands_in_the_units_and_commands(interpreter: Path, tmp_path: Path) -> None:
    place = tmp_path / "root"
    assert make("install", interpreter, DESTDIR=place, PREFIX="/srv/valves").returncode == 0
    unit = (place / "etc/systemd/system/positioner@.service").read_text(encoding="utf-8")
    assert "\nExecStart=/srv/valves/bin/positioner run " in unit
    assert (place / "usr/local/bin/positioner").readlink() == Path("/srv/valves/bin/positioner")


def test_uninstall_takes_what_install_put_and_keeps_configurations_and_tables(
    interpreter: Path, tmp_path: Path
) -> None:
    place = tmp_path / "root"
    assert make("install", interpreter, DESTDIR=place).returncode == 0
    kept = {
        "etc/positioner/fv101.toml",
        "var/lib/positioner/fv101/stiction.sqlite",
        "usr/local/bin/other",
        "usr/local/share/man/man1/positioning.1",
        "etc/systemd/system/other.service",
    }
    for name in kept:
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text("kept", encoding="utf-8")
    done = make("uninstall", interpreter, DESTDIR=place)
    assert done.returncode == 0, done.stderr
    assert files_below(place) == kept
    assert f"kept: {place}/etc/positioner" in done.stdout
    assert f"{place}/var/lib/positioner" in done.stdout
    assert make("uninstall", interpreter, DESTDIR=place).returncode == 0


def test_a_command_of_somebody_else_is_not_removed(interpreter: Path, tmp_path: Path) -> None:
    place = tmp_path / "root"
    assert make("install", interpreter, DESTDIR=place).returncode == 0
    command = place / "usr/local/bin/positioner"
    command.unlink()
    command.symlink_to("/home/somebody/positioner")
    assert make("uninstall", interpreter, DESTDIR=place).returncode == 0
    assert command.is_symlink()


@pytest.mark.parametrize("target", ["install", "uninstall"])
def test_a_directory_that_is_not_ours_is_left_alone(target: str, interpreter: Path, tmp_path: Path) -> None:
    place = tmp_path / "root"
    (place / "opt/positioner").mkdir(parents=True)
    (place / "opt/positioner/precious").write_text("kept", encoding="utf-8")
    done = make(target, interpreter, DESTDIR=place)
    assert done.returncode != 0
    assert re.search(rf"make {target}: .*/opt/positioner .*made by", done.stderr)
    assert files_below(place) == {"opt/positioner/precious"}


def test_an_interpreter_in_a_home_directory_is_refused(
    interpreter: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("BASE_PREFIX", "/home/somebody/.pyenv/versions/3.11.7")
    done = make("install", interpreter, DESTDIR=tmp_path / "root")
    assert done.returncode != 0
    assert "no service can run a Python in a home directory" in done.stderr
    assert not (tmp_path / "root").exists()
