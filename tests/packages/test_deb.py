"""The Debian package of `make deb`: its fields, its files and its bits, built from a stand-in that fetches nothing.

`make test-packages` builds, installs and removes the real one.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
INTERPRETER = r"""#!/bin/sh
# an environment with two programs, and answers to what the build asks
case "$1 $2 $3" in
"-m venv --clear")
    information=$4/lib/python3.12/site-packages/sticking_valve_positioner-1.2.dist-info
    mkdir -p "$4/bin" "$information"
    cp "$0" "$4/bin/python"
    echo "command = python -m venv $4" > "$4/pyvenv.cfg"
    echo "{\"url\": \"file://$4\"}" > "$information/direct_url.json"
    for program in positioner plant-emulator; do
        printf '#!%s/bin/python\n' "$4" > "$4/bin/$program"
        chmod 755 "$4/bin/$program"
    done ;;
"-B -m documents.manual") mkdir -p "$4" && echo "a page" > "$4/positioner.1" ;;
"-P building/completions.py "*) mkdir -p "$3/zsh" && echo "for zsh" > "$3/zsh/_positioner" ;;
"-c "*importlib*) echo 1.2 ;;
"-c "*version_info*) echo 3.12 3.13 ;;
"-c "*) echo /usr ;;
esac
"""


def build(folder: Path, **changes: str) -> Path:
    """Return the package that `make deb` builds with the stand-in, in a folder of this test's own."""
    interpreter = folder / "python"
    folder.mkdir()
    interpreter.write_text(INTERPRETER, encoding="utf-8")
    interpreter.chmod(0o755)
    given = {"INSTALL_PYTHON": interpreter, "DEB_ROOT": folder / "root", "DIST": folder / "dist"}
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "PREFIX", "DESTDIR"))}
    done = subprocess.run(
        ["make", "--directory", str(ROOT), "deb", *(f"{name}={value}" for name, value in given.items())],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env={**clean, "SOURCE_DATE_EPOCH": "1700000000", **changes},
    )
    assert done.returncode == 0, f"{done.stdout[-1000:]}{done.stderr[-3000:]}"
    return folder / "dist" / "sticking-valve-positioner.deb"


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    assert shutil.which("dpkg-deb"), "dpkg-deb is missing: make deb needs Debian or Ubuntu"
    return build(tmp_path_factory.mktemp("deb") / "first")


def told(*command: str | Path) -> str:
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True, timeout=300).stdout


def test_the_fields_name_the_python_that_it_was_built_with(package: Path) -> None:
    assert told("dpkg-deb", "--field", package, "Package", "Version", "Architecture").splitlines() == [
        "Package: sticking-valve-positioner",
        "Version: 1.2-1",
        f"Architecture: {told('dpkg', '--print-architecture').strip()}",
    ]
    assert told("dpkg-deb", "--field", package, "Depends").startswith("python3 (>= 3.12), python3 (<< 3.13), ")
    assert int(told("dpkg-deb", "--field", package, "Installed-Size")) > 0
    assert "@" not in told("dpkg-deb", "--field", package).replace("<authors@localhost>", "")


def test_it_holds_what_make_install_puts_where_packages_put_it(package: Path, tmp_path: Path) -> None:
    listed = told("dpkg-deb", "--contents", package)
    assert {line.split()[1] for line in listed.splitlines()} == {"root/root"}
    told("dpkg-deb", "--extract", package, tmp_path)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*")}
    name = "sticking-valve-positioner"
    assert {
        *("usr/bin/positioner", "usr/bin/plant-emulator", "opt/positioner/bin/positioner"),
        *("usr/lib/systemd/system/positioner@.service", "usr/lib/systemd/system/vcan0.service"),
        *("usr/share/zsh/_positioner", "usr/share/man/man1/positioner.1.gz", "etc/positioner"),
        *("opt/positioner/share/positioner/bus.conf", f"usr/share/doc/{name}/changelog.Debian.gz"),
        *(
            f"usr/share/doc/{name}/copyright",
            f"usr/share/doc/{name}/changelog.gz",
            f"usr/share/lintian/overrides/{name}",
        ),
    } <= found
    assert not [path for path in found if path.startswith(("usr/local", "etc/systemd"))]
    assert (tmp_path / "usr/bin/positioner").readlink() == Path("/opt/positioner/bin/positioner")
    # what the files say of themselves, and nothing of the folder of the build
    sums = subprocess.run(
        ["md5sum", "--check", "--quiet", "-"], input=sums_of(package), cwd=tmp_path, text=True, check=True
    )
    assert sums.returncode == 0
    for path in (each for each in tmp_path.rglob("*") if each.is_file() and not each.is_symlink()):
        assert str(package.parents[1]).encode() not in path.read_bytes(), path


def sums_of(package: Path) -> str:
    """Return the checksums in a package, which stand for all of its files."""
    sums = told("dpkg-deb", "--info", package, "md5sums")
    listed = told("dpkg-deb", "--contents", package).splitlines()
    assert len(sums.splitlines()) == len([line for line in listed if line.startswith("-")])
    return sums


def test_the_same_source_gives_the_same_bits(package: Path, tmp_path: Path) -> None:
    assert build(tmp_path / "second").read_bytes() == package.read_bytes()
    other = build(tmp_path / "third", MAINTAINER="Somebody <somebody@valves.example>")
    assert told("dpkg-deb", "--field", other, "Maintainer").strip() == "Somebody <somebody@valves.example>"


@pytest.mark.parametrize("script", ["preinst", "postinst", "prerm", "postrm"])
def test_the_scripts_are_shell_that_a_machine_without_systemd_runs(package: Path, script: str) -> None:
    text = told("dpkg-deb", "--info", package, script)
    assert text.startswith("#!/bin/sh\n")
    # nothing is done to this machine: /run/systemd/system and /opt/positioner become folders that are nowhere
    nowhere = re.sub(r"/(run/systemd/system|opt/positioner)", r"/nowhere/\1", text)
    for arguments in (["install"], ["configure"], ["upgrade", "2.0"], ["remove"], ["purge"], ["abort-upgrade", "1.0"]):
        subprocess.run(["sh", "-e", "-u", "-s", "--", *arguments], input=nowhere, text=True, check=True, timeout=300)


def test_a_valve_under_control_and_an_installation_by_make_are_refused(package: Path, tmp_path: Path) -> None:
    tools = tmp_path / "tools"
    tools.mkdir()
    (tools / "systemctl").write_text(
        "#!/bin/sh\necho 'positioner@fv101.service loaded active running'\n", encoding="utf-8"
    )
    (tools / "systemctl").chmod(0o755)
    (tmp_path / "pyvenv.cfg").write_text("", encoding="utf-8")
    for script, argument, complaint in (
        ("prerm", "remove", "still running; first: sudo systemctl stop positioner@fv101.service"),
        ("prerm", "upgrade", "still running; first: sudo systemctl stop positioner@fv101.service"),
        ("preinst", "install", "there from make install; first: sudo make uninstall"),
    ):
        text = told("dpkg-deb", "--info", package, script)
        text = re.sub(r"/(run/systemd/system|opt/positioner(?=/))", str(tmp_path), text)
        done = subprocess.run(
            ["sh", "-s", "--", argument],
            input=text,
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
            env={"PATH": f"{tools}:{os.environ['PATH']}"},
        )
        assert done.returncode == 1
        assert complaint in done.stderr
