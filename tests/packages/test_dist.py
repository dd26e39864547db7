"""What `make dist` builds: a wheel that runs outside of the clone, and a source archive that gives the same wheel."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("positioner", "plant_emulator")
OF_METADATA = {"METADATA", "WHEEL", "RECORD", "entry_points.txt", "licenses/LICENSE"}


def run(*command: str | Path, **options: str | Path | dict[str, str]) -> str:
    """Return what a command prints.

    Raises:
        AssertionError: it failed.
    """
    done = subprocess.run(
        list(map(str, command)),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        **options,  # type: ignore[call-overload]
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
    return str(done.stdout)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that `make dist` has filled; the wheel in it is built from the archive, far from any git."""
    folder = tmp_path_factory.mktemp("dist")
    binaries = Path(sys.executable).parent
    clean = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    made = {f"{name}={value}" for name, value in {"DIST": folder, "BIN": binaries, "VENV": binaries.parent}.items()}
    there = f"--old-file={binaries.parent / 'installed'}"
    printed = run("make", "--directory", ROOT, there, "dist", *sorted(made), env=clean)
    assert printed.count("PASSED") == len(list(folder.iterdir())) == 2
    return folder


def sources() -> set[str]:
    """Return the files below the packages of this clone that a user needs."""
    paths = (path for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file())
    return {str(path.relative_to(ROOT)) for path in paths if "__pycache__" not in path.parts}


def test_the_wheel_is_for_every_machine_and_holds_the_packages_and_nothing_else(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    assert wheel.name.endswith("-py3-none-any.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    (information,) = {name.split("/")[0] for name in names if ".dist-info/" in name}
    expected = sources() | {"positioner/wire/positioner.dbc"} | {f"{information}/{name}" for name in OF_METADATA}
    assert names == expected
    # of each kind at least one: a folder that moved would be missing on both sides
    assert {
        "positioner/py.typed",
        "positioner/example.toml",
        "positioner/report/page.html.j2",
        "positioner/monitor/page.html",
        "positioner/bench/scenarios/paper-valve.toml",
        "plant_emulator/presets/paper.toml",
    } <= names


def test_the_archive_holds_what_a_developer_needs(built: Path) -> None:
    (archive,) = built.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        names = {name.partition("/")[2] for name in opened.getnames()}
    needed = {
        *("pyproject.toml", "Makefile", "LICENSE", "README.md", "dbc/positioner.dbc", "building/hook.py"),
        *("requirements/run.txt", "tests/conftest.py", "systemd/positioner@.service", "examples/fv101.toml"),
    }
    assert needed | sources() <= names
    assert not {name for name in names if re.search(r"(^|/)(\.venv|out|build|dist|__pycache__)/|\.pyc$", name)}


def test_an_installed_wheel_runs_far_from_the_clone(built: Path, tmp_path: Path) -> None:
    (wheel,) = built.glob("*.whl")
    environment = tmp_path / "environment"
    run(sys.executable, "-m", "venv", "--without-pip", environment)
    library = Path(sysconfig.get_path("purelib", vars={"base": str(environment)}))
    run(sys.executable, "-m", "pip", "--python", environment / "bin/python", "install", "--quiet", "--no-deps", wheel)
    # the packages of others are those of the tests, of which no `.pth` is read: of ours there is the wheel's alone
    (library / "others.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    program, emulator = environment / "bin/positioner", environment / "bin/plant-emulator"
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}

    def far(*command: str | Path) -> str:
        return run(*command, cwd=tmp_path, env=clean)

    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert far(program, "--version").startswith(f"positioner {version} ")
    assert far(emulator, "--version").startswith(f"plant-emulator {version} ")
    place = far(environment / "bin/python", "-c", "import positioner; print(positioner.__file__)").strip()
    assert Path(place).is_relative_to(library)
    (tmp_path / "valve.toml").write_text(far(program, "check", "--example"), encoding="utf-8")
    assert "valve.toml" in far(program, "check", "valve.toml")
    assert "paper" in far(emulator, "presets")
    scenario = (library / "positioner/bench/scenarios/paper-valve.toml").read_text(encoding="utf-8")
    short = scenario.replace("visits = 3", "visits = 1").replace("dwell_s = 1.2", "dwell_s = 0.5")
    (tmp_path / "short.toml").write_text(short, encoding="utf-8")
    far(program, "bench", "--scenario", "short.toml", "--out", "bench")
    assert (tmp_path / "bench/trend.png").stat().st_size > 10_000
