"""`python -m documents.notebooks FOLDER` executes the notebooks of `examples/`, which the site then shows. Shell."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import nbclient
import nbconvert
import nbformat

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))
EXECUTED = ROOT / "out" / "notebooks"
_LONGEST_CELL_S = 600


def execute(folder: Path) -> None:
    """Execute each notebook in an empty directory of its own, with the programs of this environment on the path."""
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    folder.mkdir(parents=True, exist_ok=True)
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        with tempfile.TemporaryDirectory() as place:
            resources = {"metadata": {"path": place}}
            nbclient.NotebookClient(notebook, timeout=_LONGEST_CELL_S, resources=resources).execute()
        nbformat.write(notebook, folder / path.name)


def pages() -> dict[str, str | bytes]:
    """Return the executed notebooks as pages in Markdown with their pictures, by their places on the site.

    Raises:
        FileNotFoundError: `make notebooks` has not been here.
    """
    found: dict[str, str | bytes] = {}
    for path in NOTEBOOKS:
        notebook = nbformat.read(EXECUTED / path.name, as_version=4)
        names = {"unique_key": path.stem, "output_files_dir": f"{path.stem}_files"}
        text, resources = nbconvert.MarkdownExporter().from_notebook_node(notebook, names)
        found[f"notebooks/{path.stem}.md"] = text
        found |= {f"notebooks/{name}": picture for name, picture in resources["outputs"].items()}
    return found


if __name__ == "__main__":
    execute(Path(sys.argv[1]))
