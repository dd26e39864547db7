"""The lock files of `make install` and of the tests hold what pyproject.toml asks for, in one version, with hashes."""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from typing import TYPE_CHECKING

import pytest
from harness import locked
from harness.plan import PROJECT
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

if TYPE_CHECKING:
    from pathlib import Path

LOCKS = ("run.txt", "build.txt", "dev.txt")
PYTHONS = ("3.11", "3.12", "3.13")
SHA256_DIGITS = 64


def asked() -> dict[str, list[Requirement]]:
    """Return what pyproject.toml asks for, by lock file."""
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    compiler = project["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]["compiler"]
    needed = [Requirement(text) for text in project["project"]["dependencies"]]
    extras = project["project"]["optional-dependencies"]
    return {
        "run.txt": needed,
        "dev.txt": [*needed, *of_extras({"dev", "site"}, extras, project["project"]["name"])],
        "build.txt": [Requirement(text) for text in [*project["build-system"]["requires"], *compiler]],
    }


def of_extras(names: set[str], extras: dict[str, list[str]], project: str) -> list[Requirement]:
    """Return what some extras of the project ask for, with that of the extras which they name."""
    found = [Requirement(text) for name in sorted(names) for text in extras[name]]
    further = set().union(*(each.extras for each in found if each.name == project)) - names
    own = [each for each in found if each.name != project]
    return [*own, *of_extras(further, extras, project)] if further else own


def held(lock: str, python: str) -> dict[str, locked.Locked]:
    """Return the packages of a lock file that are for one Python, by name."""
    entries = [entry for entry in locked.read(PROJECT / "requirements" / lock) if entry.applies(python)]
    by_name = {entry.name: entry for entry in entries}
    assert len(by_name) == len(entries), "two versions of one package"
    return by_name


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_holds_what_is_asked_for_in_a_version_that_is_wanted(lock: str, python: str) -> None:
    entries = held(lock, python)
    for requirement in asked()[lock]:
        entry = entries.get(canonicalize_name(requirement.name))
        assert entry, f"requirements/{lock} lacks {requirement}: make lock"
        assert requirement.specifier.contains(entry.version, prereleases=True), f"{requirement}: make lock"


@pytest.mark.parametrize("python", PYTHONS)
def test_a_lock_holds_what_its_packages_ask_for_in_turn(python: str) -> None:
    entries = held("run.txt", python)
    extras = {str(canonicalize_name(requirement.name)): requirement.extras for requirement in asked()["run.txt"]}
    environment = {"python_version": python, "python_full_version": f"{python}.0", "sys_platform": "linux"}
    for name in entries:
        for text in importlib.metadata.requires(name) or []:
            needed = Requirement(text)
            chosen = [{**environment, "extra": extra} for extra in extras.get(name, set()) or {""}]
            if needed.marker is None or any(needed.marker.evaluate(dict(one)) for one in chosen):
                assert canonicalize_name(needed.name) in entries, f"{name} needs {text}: make lock"


@pytest.mark.parametrize("lock", ["run.txt", "dev.txt"])
def test_what_a_package_asks_for_with_an_extra_is_pinned_with_it(lock: str) -> None:
    """Else pip, which then looks for a pin of the extra, refuses the lock once a newer version is out."""
    text, entries = (PROJECT / "requirements" / lock).read_text(encoding="utf-8"), held(lock, "3.11")
    environment = {"python_version": "3.11", "python_full_version": "3.11.0", "sys_platform": "linux", "extra": ""}
    for name in entries:
        for requirement in importlib.metadata.requires(name) or []:
            needed = Requirement(requirement)
            if needed.extras and (needed.marker is None or needed.marker.evaluate(dict(environment))):
                pinned = re.search(rf"^{re.escape(needed.name)}\[([\w,-]+)\]==", text, re.MULTILINE | re.IGNORECASE)
                assert pinned, f"requirements/{lock}: {name} needs {requirement}"
                assert needed.extras <= set(pinned[1].split(",")), f"{name} needs {requirement}"


@pytest.mark.parametrize("lock", LOCKS)
def test_every_package_of_a_lock_is_pinned_with_hashes_and_no_host_is_named(lock: str) -> None:
    entries = locked.read(PROJECT / "requirements" / lock)
    assert len(entries) >= len(asked()[lock])
    for entry in entries:
        assert entry.hashes, entry.name
        assert {(kind, len(value)) for kind, value in entry.hashes} == {("sha256", SHA256_DIGITS)}, entry.name
    text = (PROJECT / "requirements" / lock).read_text(encoding="utf-8")
    for word in ("://", "index-url", "find-links", "-e ", " @ "):
        assert word not in text


def test_a_line_that_pins_nothing_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "run.txt"
    path.write_text("numpy>=1.26\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"run\.txt: 'numpy>=1\.26' is no pinned package"):
        locked.read(path)
