"""What MkDocs calls while it builds the site: pages from outside of `docs/`, pages made from the code, links. Shell."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.structure.files import File

from documents import api, campaign, commands, configuration, frames, notebooks, plant, scenario
from documents.links import FILES, linked, place_of, rewritten

if TYPE_CHECKING:
    from collections.abc import Callable

    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
BESIDE = ("README.md", "DESIGN.md", "CONTRIBUTING.md", "SAFETY.md", "SECURITY.md", "CHANGELOG.md", "LICENSE")
MADE: dict[str, Callable[[], str]] = {
    "reference/configuration.md": configuration.page,
    "reference/plant-files.md": plant.page,
    "reference/scenario-files.md": scenario.page,
    "reference/campaign-files.md": campaign.page,
    "reference/positioner.md": lambda: commands.page(commands.programs()[0]),
    "reference/frames.md": frames.page,
    "reference/api.md": api.page,
    "reference/plant-emulator.md": lambda: commands.page(commands.programs()[1]),
}
"""Pages that are made from the code."""


def _exists(path: str) -> bool:
    return (ROOT / path).is_file()


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages beside the README, and the files to which pages link."""
    for name in BESIDE:
        files.append(File.generated(config, place_of(name), abs_src_path=str(ROOT / name)))
    for place, page in MADE.items():
        files.append(File.generated(config, place, content=page()))
    for place, content in notebooks.pages().items():
        files.append(File.generated(config, place, content=content))
    pages = [*(name for name in BESIDE if name.endswith(".md")), *(f"docs/{page.src_uri}" for page in _pages(files))]
    others = {
        each for page in pages if _exists(page) for each in linked((ROOT / page).read_text("utf-8"), page, _exists)
    }
    for other in sorted(others):
        if (place := place_of(other)).startswith(FILES) and place not in files.src_uris:
            files.append(File.generated(config, place, abs_src_path=str(ROOT / other)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001 - MkDocs's
    """Return a page of the repository with the site's links."""
    origin = "README.md" if page.file.src_uri == "index.md" else page.file.src_uri
    path = origin if origin in BESIDE else f"docs/{origin}"
    if origin.startswith("notebooks/"):
        path = origin.replace("notebooks/", "examples/").replace(".md", ".ipynb")
    return rewritten(markdown, path, _exists) if _exists(path) else markdown


def _pages(files: Files) -> list[File]:
    return [file for file in files if file.is_documentation_page()]
