"""The short form of `make soak`, half a minute instead of an hour, and its measurements."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import pytest

from endurance.pulse import Pulse

_SECONDS = 30


@pytest.mark.slow
@pytest.mark.bus
def test_half_a_minute_with_restarts_and_an_outage_leak_nothing_and_lose_nothing() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    # an hour is enough to distinguish 1 % of growth from a cache that fills; half a minute, with three daemons, 3 %
    command = [sys.executable, "-m", "endurance.soak", "--seconds", str(_SECONDS), "--growth", "0.03"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert len(re.findall(r"^(daemon|writer) ", done.stdout, re.MULTILINE)) == 6, done.stdout
    learned = re.search(r"^learned samples: (\d+)$", done.stdout, re.MULTILINE)
    assert learned, done.stdout
    assert int(learned[1]) >= 1, done.stdout
    assert done.stdout.endswith("violations: 0\n"), done.stdout


def pulse(memory_bytes: list[int], descriptors: list[int]) -> Pulse:
    return Pulse("daemon", 0, [float(number) for number in range(len(memory_bytes))], memory_bytes, descriptors)


def test_memory_that_grows_after_the_warm_up_is_given_as_a_share_of_its_mean() -> None:
    steady = [1000] * 40 + [2000] * 60
    assert pulse(steady, [8] * 100).growth == 0.0
    growing = [1000] * 40 + [2000 + 10 * number for number in range(60)]
    assert pulse(growing, [8] * 100).growth == pytest.approx(590 / 2295)
    assert pulse(growing[::-1], [8] * 100).growth < 0.0


def test_a_descriptor_counts_as_leaked_when_it_stays_and_not_when_a_commit_opens_it() -> None:
    commits = [8, 8, 10] * 10
    assert pulse([1] * 30, commits).leaked == 0
    assert pulse([1] * 30, commits[:20] + [number + 1 for number in commits[20:]]).leaked == 1


def test_a_pulse_of_this_process_sees_its_memory_and_a_file_that_it_opens() -> None:
    own = Pulse("test", os.getpid())
    own.measure(0.0)
    descriptor = os.open(os.devnull, os.O_RDONLY)
    own.measure(1.0)
    os.close(descriptor)
    assert own.descriptors[1] == own.descriptors[0] + 1
    assert 10_000_000 < own.memory_bytes[0] < 10_000_000_000


def test_a_process_that_is_gone_leaves_its_pulse_as_it_was() -> None:
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    one = Pulse("gone", gone.pid)
    one.measure(0.0)
    assert one.times_s == []
    assert not one.is_long
