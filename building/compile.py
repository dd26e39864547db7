"""Compile the pure modules with mypyc: `python -m building.compile ROOT BUILD`.

ROOT is the source tree, which stays as it is; BUILD receives a copy with expanded dataclasses, the C code, and, in
BUILD/lib, the compiled modules. The build hook's table in pyproject.toml names them.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from building.expand import expand, replacements_of
from building.values import values_of

if TYPE_CHECKING:
    from setuptools import Extension  # type: ignore[import-untyped,unused-ignore]

_MYPY = """[mypy]
ignore_missing_imports = True
follow_imports = silent
[mypy-annotated_types.*,can.*,cantools.*,numpy.*,osqp.*,pydantic.*,scipy.*,tqdm.*]
follow_imports = skip
follow_imports_for_stubs = True
"""
"""What is not compiled counts as untyped, whether the build environment has it or not: the same C code everywhere."""

_PORTABLE = ["-O2", "-g0", "-w", "-ffp-contract=off"]
"""The same bits on every processor: no fused multiplication and addition."""

_GROUP = "sticking_valve_positioner"


def compiled_modules(root: Path) -> list[str]:
    """Return the files to compile, relative to `root`."""
    table = tomllib.loads((root / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    patterns = table["hooks"]["custom"]["modules"]
    found = {each for pattern in patterns for each in root.glob(pattern) if not _is_shell(each)}
    return sorted(each.relative_to(root).as_posix() for each in found)


def _is_shell(path: Path) -> bool:
    """Return whether a module does input and output, as its docstring tells."""
    return (ast.get_docstring(ast.parse(path.read_bytes())) or "").endswith("Shell.")


def prepare(root: Path, build: Path) -> tuple[list[str], dict[str, list[int]]]:
    """Copy the packages, expand the modules to compile; return their names, and their line numbers in the source."""
    shutil.rmtree(build, ignore_errors=True)
    for package in ("positioner", "plant_emulator"):
        shutil.copytree(root / package, build / package, ignore=shutil.ignore_patterns("*.so", "__pycache__"))
    shutil.copy(Path(__file__).with_name("native.py"), build / "positioner" / "native.py")
    files = {name.removesuffix(".py").replace("/", "."): name for name in compiled_modules(root)}
    trees = {module: ast.parse((root / name).read_bytes()) for module, name in files.items()}
    values = values_of(trees)
    replacements = replacements_of(trees.values(), (value for each in values.values() for value in each.values()))
    lines: dict[str, list[int]] = {}
    for module, name in files.items():
        text, lines[name] = expand((root / name).read_bytes(), trees[module], values[module], replacements)
        (build / name).write_bytes(text)
    return list(files.values()), lines


def compile_modules(files: list[str], lines: dict[str, list[int]]) -> None:
    """Write the C code of the modules in the working directory, and compile it to lib/."""
    from mypyc.build import mypycify  # noqa: PLC0415 - not there where no compiler is
    from setuptools import setup  # type: ignore[import-untyped,unused-ignore]  # noqa: PLC0415 - the same
    from setuptools.command.build_ext import build_ext  # type: ignore[import-untyped,unused-ignore]  # noqa: PLC0415

    class BuildParallel(build_ext):  # type: ignore[misc,unused-ignore]
        """Compiles the files of one extension on all processors; setuptools only takes extensions side by side."""

        def build_extension(self, ext: Extension) -> None:
            def compiled(source: str) -> list[str]:
                objects: list[str] = self.compiler.compile(
                    [source],
                    output_dir=self.build_temp,
                    include_dirs=ext.include_dirs,
                    extra_postargs=ext.extra_compile_args,
                    depends=ext.depends,
                )
                return objects

            with ThreadPoolExecutor(os.cpu_count()) as pool:
                ext.extra_objects = [each for objects in pool.map(compiled, ext.sources) for each in objects]
            ext.sources = []
            super().build_extension(ext)

    Path("mypy.ini").write_text(_MYPY)
    # a file for each module: one for all takes the C compiler twice as long, on one processor
    arguments = ["--config-file=mypy.ini", "--no-incremental", *files]
    extensions = mypycify(arguments, target_dir="c", group_name=_GROUP, multi_file=True)
    for path in Path("c").rglob("*.c"):
        path.write_text(with_lines_of_source(path.read_text(), lines))
    for extension in extensions:
        kept = [each for each in extension.extra_compile_args if not re.match(r"-O|-g|-W", each)]
        extension.extra_compile_args = [*kept, *_PORTABLE]
    setup(
        name=_GROUP,
        packages=[],
        ext_modules=extensions,
        cmdclass={"build_ext": BuildParallel},
        script_args=["build_ext", "--build-lib=lib"],
    )


def with_lines_of_source(code: str, lines: dict[str, list[int]]) -> str:
    """Return the C code with tracebacks that name the lines of the source, and without indentation.

    mypyc indents some functions by hundreds of columns, which takes the C compiler longer than the code.
    """
    code = re.sub(r"^ +", " ", code, flags=re.MULTILINE)
    return re.sub(
        r'("([\w/]+\.py)", "[^"]*", )(\d+)',
        lambda found: f"{found[1]}{lines[found[2]][int(found[3]) - 1]}" if found[2] in lines else found[0],
        code,
    )


def main() -> None:
    """Compile what the arguments name."""
    root, build = (Path(each).resolve() for each in sys.argv[1:3])
    files, lines = prepare(root, build)
    os.chdir(build)
    compile_modules(files, lines)


if __name__ == "__main__":
    main()
