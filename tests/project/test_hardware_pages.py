"""The hardware pages: every configuration on them passes `positioner check`, with options that python-can knows."""

from __future__ import annotations

import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest
from can.interfaces import BACKENDS

from positioner.cli.main import main
from positioner.errors import ExitCode

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted((ROOT / "docs").glob("hardware*.md"))
VALVE = '[valve]\nid = "fv101"\npreset = "paper"\n\n'
TOML = re.compile(r"^```toml\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SNIPPETS = [
    (page.name, number, snippet)
    for page in PAGES
    for number, snippet in enumerate(TOML.findall(page.read_text(encoding="utf-8")))
]


def test_each_adapter_has_a_page_with_configuration_service_and_what_to_expect() -> None:
    adapters = {"gs-usb", "kvaser", "pcan", "slcan", "socketcan"}
    assert {page.stem for page in PAGES} == {"hardware", *(f"hardware-{name}" for name in adapters)}
    assert {name for name, _, _ in SNIPPETS} == {f"hardware-{name}.md" for name in adapters}
    overview = (ROOT / "docs" / "hardware.md").read_text(encoding="utf-8")
    for name in adapters:
        text = (ROOT / "docs" / f"hardware-{name}.md").read_text(encoding="utf-8")
        assert "\n## The service\n" in text
        assert "\n## What to expect\n" in text
        assert f"(hardware-{name}.md)" in overview
    assert "(protocol.md)" in overview
    assert "positioner conformance plant" in overview


@pytest.mark.parametrize(("page", "number", "snippet"), SNIPPETS)
def test_a_configuration_on_a_page_passes_the_check(
    page: str, number: int, snippet: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"{page}-{number}.toml"
    path.write_text(VALVE + snippet, encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK, capsys.readouterr().err
    told = capsys.readouterr().out
    interface = re.search(r'^interface = "(.*)"$', snippet, re.MULTILINE)
    assert interface
    assert f"bus                    {interface[1]}:" in told


@pytest.mark.parametrize(("page", "number", "snippet"), SNIPPETS)
def test_python_can_knows_each_option_on_a_page(page: str, number: int, snippet: str) -> None:
    bus = tomllib.loads(snippet)["bus"]
    specification = find_spec(BACKENDS[bus["interface"]][0])
    assert specification is not None
    assert specification.origin is not None
    source = Path(specification.origin)
    sources = source.parent.glob("*.py") if source.name == "__init__.py" else (source,)
    texts = [each.read_text(encoding="utf-8") for each in sources]
    for option in bus.get("options", {}):
        assert any(re.search(rf"\b{option}\b", text) for text in texts), (page, number, option)


def test_the_load_on_the_overview_is_that_of_the_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(VALVE, encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.OK
    assert "bus load               30 % of 1 Mbit/s" in capsys.readouterr().out
    assert "takes 30 %, and 0.31 ms" in (ROOT / "docs" / "hardware.md").read_text(encoding="utf-8")


def test_an_option_that_does_not_belong_to_the_interface_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "valve.toml"
    path.write_text(f'{VALVE}[bus]\ninterface = "socketcan"\n[bus.options]\nbitrate = 500000\n', encoding="utf-8")
    assert main(["check", str(path)]) == ExitCode.CONFIG
