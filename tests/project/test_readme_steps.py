"""The five steps of docs/install.md: blocks for a shell, made of commands and files that there are."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from positioner.cli.main import build_parser

pytestmark = pytest.mark.bus
ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
SECTION = PAGE.split("\n## A real positioner in five steps\n")[1].split("\n## ")[0]
STEPS = re.findall(r"^```sh\n(.*?)^```$", SECTION, flags=re.DOTALL | re.MULTILINE)
SHARE = "/opt/positioner/share/positioner/"


def commands(program: str) -> list[list[str]]:
    """Return the arguments of every call of a program in the steps, up to where the shell takes over."""
    found = []
    for line in "".join(STEPS).splitlines():
        words = shlex.split(line)
        for start, word in enumerate(words):
            if word == program:
                rest = words[start + 1 :]
                end = next((n for n, each in enumerate(rest) if each in {"|", "||", "&&", ">"}), len(rest))
                found.append(rest[:end])
    return found


def test_there_are_five_steps_each_with_one_block() -> None:
    assert re.findall(r"^\*\*(\d)\. ", SECTION, flags=re.MULTILINE) == ["1", "2", "3", "4", "5"]
    assert len(STEPS) == 5


@pytest.mark.parametrize("step", range(1, 6))
def test_a_step_is_a_script_that_bash_can_read(step: int) -> None:
    bash = shutil.which("bash")
    assert bash, "bash is missing"
    done = subprocess.run([bash, "-n"], input=STEPS[step - 1], capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")


def test_every_call_of_the_positioner_is_one_that_it_understands() -> None:
    called = commands("positioner")
    assert [arguments[0] for arguments in called] == ["check", "check", "doctor", "run", "table"]
    for arguments in called:
        build_parser().parse_args(arguments)


def test_every_file_that_is_copied_is_one_that_make_install_leaves() -> None:
    copied = re.findall(rf"{SHARE}(\S+)", "".join(STEPS))
    assert sorted(copied) == ["80-can.link", "80-can.network", "bus.conf"]
    shipped = {path.name for path in (*(ROOT / "systemd").glob("*.conf"), *(ROOT / "systemd/network").iterdir())}
    assert set(copied) <= shipped


def test_the_bus_of_the_steps_is_that_of_the_example_and_of_the_drop_in() -> None:
    example = (ROOT / "positioner" / "example.toml").read_text(encoding="utf-8")
    assert '\nchannel = "can0"\n' in example
    assert "net/can0" in STEPS[1]
    assert "-can0.device" in (ROOT / "systemd" / "bus.conf").read_text(encoding="utf-8")


def test_what_is_run_is_what_make_makes_and_systemd_starts() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert commands("make") == [["install"]]
    assert "\ninstall:" in makefile
    units = {word for arguments in commands("systemctl") for word in arguments if "@" in word}
    assert units == {"positioner@fv101"}
    assert (ROOT / "systemd" / "positioner@.service").is_file()
