"""The packages that `make install` asks for, fetched on the host: inside a kernel there is no network."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

from harness import locked
from harness.packages import CannotFetchError
from harness.plan import PROJECT, WHEELS

LOCKS = (PROJECT / "requirements" / "build.txt", PROJECT / "requirements" / "run.txt")
_SYSTEM_PYTHON = Path("/usr/bin/python3")


def fetch() -> None:
    """Download the wheels for the Python that `make install` takes, once.

    Raises:
        CannotFetchError: they cannot be had.
    """
    version = _version()
    # pip would evaluate the markers for the Python that runs it
    wanted = [entry.line() for path in LOCKS for entry in locked.read(path) if entry.applies(version)]
    text = "\n".join(sorted(set(wanted))) + "\n"
    finished = WHEELS / hashlib.sha256(f"{version} {text}".encode()).hexdigest()[:12]
    if finished.exists():
        return
    WHEELS.mkdir(parents=True, exist_ok=True)
    requirements = WHEELS / "requirements.txt"
    requirements.write_text(text, encoding="utf-8")
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--dest", str(WHEELS)]
    options = ["--only-binary", ":all:", "--implementation", "cp", "--python-version", version, "--no-deps"]
    exactly = ["--require-hashes", "--requirement", str(requirements)]
    done = subprocess.run([*pip, *options, *exactly], check=False, capture_output=True, text=True)
    if done.returncode:
        raise CannotFetchError(
            f"kernel tests: pip download failed: {(done.stderr.strip() or 'unknown').splitlines()[-1]}"
        )
    finished.touch()


def _version() -> str:
    python = str(_SYSTEM_PYTHON) if _SYSTEM_PYTHON.exists() else sys.executable
    asked = [python, "-c", "import sys; print('%d.%d' % sys.version_info[:2])"]
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()
