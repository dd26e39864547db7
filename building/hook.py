"""The build of the wheel: with a C compiler it holds compiled modules, without one it holds the same source only.

POSITIONER_BUILD=pure leaves the compilation out; POSITIONER_BUILD=compiled fails where it is not possible. An editable
installation is never compiled: a compiled module would hide every change of its source.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CompiledBuildHook(BuildHookInterface[Any]):
    """Puts the compiled modules beside their source in the wheel."""

    def dependencies(self) -> list[str]:
        """Return what the compilation needs, if it is possible at all."""
        return [] if _obstacle() else list(self.config["compiler"])

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and name the results for the wheel."""
        if version == "editable":
            return
        obstacle = _obstacle()
        if not obstacle:
            self._build = Path(tempfile.mkdtemp(prefix="positioner-build-"))
            obstacle = _compile(Path(self.root), self._build)
        if obstacle:
            if os.environ.get("POSITIONER_BUILD") == "compiled":
                raise RuntimeError(f"the compiled build is not possible: {obstacle}")
            self.app.display_warning(f"positioner: interpreted build: {obstacle}")
            return
        library = self._build / "lib"
        made = {str(each): each.relative_to(library).as_posix() for each in library.rglob("*.so")}
        native = "positioner/native.py"
        build_data["force_include"] |= made | {str(self._build / native): native}
        build_data["pure_python"], build_data["infer_tag"] = False, True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove what was needed for the wheel only."""
        if hasattr(self, "_build"):
            shutil.rmtree(self._build, ignore_errors=True)


def _obstacle() -> str:
    """Return why nothing can be compiled, empty if it can."""
    if os.environ.get("POSITIONER_BUILD") == "pure":
        return "POSITIONER_BUILD=pure asks for it"
    compiler = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "cc")[0]
    if shutil.which(compiler) is None:
        return f"there is no C compiler {compiler} here"
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        return "there is no Python.h here, which a package such as python3-dev holds"
    return ""


def _compile(root: Path, build: Path) -> str:
    """Compile to `build`; return why that failed, empty if it did not."""
    command = [sys.executable, "-m", "building.compile", str(root), str(build)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=root)  # noqa: S603 - our own program
    if done.returncode == 0:
        return ""
    told = [line for line in f"{done.stdout}\n{done.stderr}".splitlines() if "rror" in line]
    return f"the compilation failed: {told[-1] if told else f'exit status {done.returncode}'}"
