"""The real package in the real image: installed in a Debian of its own, run there, and removed. Minutes; needs root.

`make test-packages` runs it, after `make image` has built both.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import printed
import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).resolve().parents[2]
PACKAGE, ARCHIVE = ROOT / "dist/sticking-valve-positioner.deb", ROOT / "dist/positioner.oci.tar"
SCENARIO = "/opt/positioner/lib/python3*/site-packages/positioner/bench/scenarios/paper-valve.toml"
NAME = "sticking-valve-positioner"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the root of the image, unpacked as a container's is."""
    assert os.geteuid() == 0, "the image's root is another root: sudo make test-packages"
    folder = tmp_path_factory.mktemp("image")
    subprocess.run(
        ["tar", "--extract", "--file", str(ARCHIVE), "--one-top-level=layout", "-C", str(folder)], check=True
    )
    unpack = ["umoci", "unpack", "--image", f"{folder}/layout:latest", f"{folder}/bundle"]
    subprocess.run(unpack, check=True, capture_output=True)
    yield folder / "bundle/rootfs"
    subprocess.run(["rm", "-r", str(folder)], check=True)


def inside(root: Path, script: str) -> str:
    """Return what a script prints in the image, in a network of its own that leads nowhere, as a container's user."""
    environment = "env -i PATH=/usr/bin:/bin HOME=/tmp"
    su = f"exec setpriv --reuid=positioner --regid=positioner --init-groups {environment} sh -ec {shlex.quote(script)}"
    enter = f"ip link set lo up; ip route add default dev lo; exec chroot {root} sh -ec {shlex.quote(su)}"
    done = subprocess.run(
        ["unshare", "--net", "sh", "-ec", enter], capture_output=True, text=True, check=False, timeout=600
    )
    assert done.returncode == 0, f"{script}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    return done.stdout


def test_another_program_reads_the_image() -> None:
    told = subprocess.run(["skopeo", "inspect", f"oci-archive:{ARCHIVE}"], check=True, capture_output=True, text=True)
    assert json.loads(told.stdout)["Os"] == "linux"


def test_the_programs_run_in_the_image_as_its_user(root: Path) -> None:
    assert inside(root, "positioner --version").startswith("positioner ")
    assert printed.PRESET in inside(root, "plant-emulator presets")
    checked = inside(root, "cd /tmp; positioner check --example > valve.toml; positioner check valve.toml")
    assert printed.CHECKED in checked
    short = f"sed 's/visits = 3/visits = 1/; s/dwell_s = 1.2/dwell_s = 0.5/' {SCENARIO} > short.toml"
    played = inside(root, f"cd /tmp; {short}; positioner bench --scenario short.toml --out bench")
    assert printed.ALWAYS_ACTIVE in played


def test_the_containers_of_the_example_share_a_bus(root: Path) -> None:
    text = (ROOT / "examples/compose.yaml").read_text(encoding="utf-8")
    plant, positioner = re.findall(r"^    command: (.+)$", text, flags=re.MULTILINE)
    for source, place in re.findall(r"^      - \./(.+?):(.+?):ro$", text, flags=re.MULTILINE):
        target = root / place.removeprefix("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text((ROOT / "examples" / source).read_text(encoding="utf-8"), encoding="utf-8")
    host = "positioner host --config /etc/positioner/fv101.toml"
    script = f"""
        {plant} & plant=$!
        {positioner} & positioner=$!
        sleep 5
        timeout 60 {host} arm set 62% status & host=$!
        sleep 15
        {host} status
        kill $host $positioner $plant; wait
    """
    told = inside(root, script)
    assert printed.ARMED in told.splitlines()
    assert (root / "var/lib/positioner/fv101").is_dir()


def test_what_is_removed_leaves_configurations_and_tables(root: Path) -> None:
    kept = {"etc/positioner/fv101.toml", "var/lib/positioner/fv101/kept"}
    for name in kept:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("kept", encoding="utf-8")
    remove = ["chroot", str(root), "dpkg", "--purge", NAME]
    subprocess.run(remove, check=True, capture_output=True)
    assert not (root / "opt/positioner").exists()
    assert not os.path.lexists(root / "usr/bin/positioner")
    assert all((root / name).read_text(encoding="utf-8") == "kept" for name in kept)
    # a package over what `make install` has put there is refused
    (root / "opt/positioner").mkdir(parents=True)
    (root / "opt/positioner/pyvenv.cfg").write_text("", encoding="utf-8")
    (root / "package.deb").write_bytes(PACKAGE.read_bytes())
    install = ["chroot", str(root), "dpkg", "--install", "/package.deb"]
    refused = subprocess.run(install, check=False, capture_output=True, text=True)
    assert refused.returncode != 0
    assert printed.UNINSTALL_FIRST in refused.stderr
