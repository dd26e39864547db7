"""The short form of `make stall-test`: the same program, fewer stalls."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest


def stalls(*arguments: str) -> tuple[int, str]:
    """Return the exit status and the report of the stall test."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    command = [sys.executable, "-m", "endurance.stalls", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.bus
def test_stalls_at_random_instants_fail_safe_and_let_nothing_old_through() -> None:
    code, report = stalls("--virtual", "60", "--real", "3", "--seed", "5")
    assert code == 0, report
    long = [(int(count), int(latched)) for count, latched in re.findall(r"(\d+), latched and logged: (\d+)", report)]
    assert [count == latched for count, latched in long] == [True, True, True], report
    assert [count > 0 for count, _ in long] == [True, False, True], report  # the second kind is not armed
    commands = [int(count) for count in re.findall(r"(\d+) commands during and after", report)]
    assert commands[0] > 10, report
    assert commands[1] > 0, report  # some ARM had not waited
    assert commands[2] > 0, report  # a busy machine lets the process answer few readings
