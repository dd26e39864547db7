"""The archive of `make image` is an OCI image layout, as its specification asks. Its root is a stand-in of one file."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
OCI = "application/vnd.oci.image."
DEBIAN = r"""#!/bin/sh
# mmdebstrap ... SUITE FILE makes a root with one file, and notes what it was asked for
for last; do :; done
echo "$@" > "$ASKED"
mkdir -p "$ASKED.root/usr/bin" && echo program > "$ASKED.root/usr/bin/positioner"
tar --create --file "$last" --directory "$ASKED.root" --sort=name --owner=0 --group=0 --mtime=@0 .
"""


def build(folder: Path) -> Path:
    """Return the archive that `building/image` makes of an empty package and the stand-in's root."""
    package, tools = folder / "package", folder / "tools"
    (package / "DEBIAN").mkdir(parents=True)
    fields = "Package: none\nVersion: 1\nArchitecture: all\nMaintainer: none <none@none>\nDescription: none\n"
    depends = "Depends: python3 (>= 3.12), python3 (<< 3.13), zlib1g\n"
    (package / "DEBIAN/control").write_text(fields + depends, encoding="utf-8")
    subprocess.run(["dpkg-deb", "--build", str(package), str(folder / "none.deb")], check=True, capture_output=True)
    tools.mkdir()
    (tools / "mmdebstrap").write_text(DEBIAN, encoding="utf-8")
    (tools / "mmdebstrap").chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{tools}:{os.environ['PATH']}",
        "ASKED": str(folder / "asked"),
        "SUITE": "trixie",
        "SOURCE_DATE_EPOCH": "1700000000",
    }
    archive = folder / "image.tar"
    done = subprocess.run(
        [str(ROOT / "building/image"), str(folder / "none.deb"), str(archive)],
        env=environment, capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return archive


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("image") / "first")


@pytest.fixture(scope="module")
def layout(archive: Path) -> Path:
    folder = archive.parent / "layout"
    folder.mkdir()
    subprocess.run(["tar", "--extract", "--file", str(archive), "--directory", str(folder)], check=True)
    return folder


def blob(layout: Path, descriptor: dict[str, Any]) -> bytes:
    """Return what a descriptor means, which has the size and the digest that it says."""
    algorithm, _, digest = str(descriptor["digest"]).partition(":")
    assert algorithm == "sha256"
    data = (layout / "blobs/sha256" / digest).read_bytes()
    assert len(data) == descriptor["size"]
    assert hashlib.sha256(data).hexdigest() == digest
    return data


def test_every_descriptor_means_a_blob_and_every_blob_is_meant(layout: Path) -> None:
    assert json.loads((layout / "oci-layout").read_text())["imageLayoutVersion"] == "1.0.0"
    index = json.loads((layout / "index.json").read_text())
    assert index["schemaVersion"] == 2
    (entry,) = index["manifests"]
    assert entry["mediaType"] == f"{OCI}manifest.v1+json"
    assert entry["annotations"] == {"org.opencontainers.image.ref.name": "latest"}
    manifest = json.loads(blob(layout, entry))
    assert manifest["schemaVersion"] == 2
    assert manifest["config"]["mediaType"] == f"{OCI}config.v1+json"
    assert [layer["mediaType"] for layer in manifest["layers"]] == [f"{OCI}layer.v1.tar+gzip"]
    configuration = json.loads(blob(layout, manifest["config"]))
    root = gzip.decompress(blob(layout, manifest["layers"][0]))
    assert configuration["rootfs"] == {"type": "layers", "diff_ids": [f"sha256:{hashlib.sha256(root).hexdigest()}"]}
    assert len(list((layout / "blobs/sha256").iterdir())) == 3


def test_a_container_runs_either_program_as_a_user_who_owns_what_is_learned(layout: Path) -> None:
    index = json.loads((layout / "index.json").read_text())
    manifest = json.loads(blob(layout, index["manifests"][0]))
    configuration = json.loads(blob(layout, manifest["config"]))
    assert configuration["os"] == "linux"
    assert configuration["created"].startswith("2023-11-14T22:13:20")
    settings = configuration["config"]
    assert "Entrypoint" not in settings
    assert settings["Cmd"] == ["positioner", "--help"]
    assert settings["User"] == "positioner"
    assert settings["WorkingDir"] == "/var/lib/positioner"
    assert list(settings["Volumes"]) == ["/var/lib/positioner"]
    assert "/usr/bin" in settings["Env"][0]


def test_the_root_is_a_debian_with_the_package_and_what_it_needs(archive: Path) -> None:
    asked = (archive.parent / "asked").read_text(encoding="utf-8")
    assert "--variant=minbase --include=python3,zlib1g " in asked
    assert f"upload '{archive.parent}/none.deb' /package.deb" in asked
    assert asked.split()[-2] == "trixie"


def test_the_same_package_gives_the_same_image(archive: Path, tmp_path: Path) -> None:
    second = build(tmp_path / "second")
    assert second.read_bytes() == archive.read_bytes()
