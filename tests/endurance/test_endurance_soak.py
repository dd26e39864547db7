"""The short form of `make soak`, half a minute instead of an hour, and its measurements."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from golden_table import FIT

from endurance import sample_log
from endurance.pulse import Pulse
from endurance.sample_log import Entry, SampleLogWriter
from endurance.soak_host import SoakHost
from endurance.soak_report import report
from endurance.table_check import difference, taught
from positioner.bus.address import embedded_address
from positioner.store import access
from positioner.store.client import TableWriterClient
from positioner.valve.stiction import Direction, LearnedSample, Quantity, StictionTable

if TYPE_CHECKING:
    from pathlib import Path

_SECONDS = 30


@pytest.mark.slow(short="test_the_report_of_a_soak_has_the_lines_that_its_long_form_is_read_by")
@pytest.mark.bus
def test_half_a_minute_with_restarts_and_an_outage_leak_nothing_and_lose_nothing() -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    # an hour is enough to distinguish 1 % of growth from a cache that fills; half a minute, with three daemons, 3 %
    command = [sys.executable, "-m", "endurance.soak", "--seconds", str(_SECONDS), "--growth", "0.03"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    processes, learned, violations = read(done.stdout)
    assert (processes, violations) == (6, 0), done.stdout
    assert learned >= 1, done.stdout


def read(output: str) -> tuple[int, int, int]:
    """Return what a soak tells: its processes, its learned samples, its violations."""
    learned = re.search(r"^learned samples: (\d+)$", output, re.MULTILINE)
    violations = re.search(r"^violations: (\d+)\n\Z", output, re.MULTILINE)
    assert learned, output
    assert violations, output
    return len(re.findall(r"^(daemon|writer) ", output, re.MULTILINE)), int(learned[1]), int(violations[1])


def test_the_report_of_a_soak_has_the_lines_that_its_long_form_is_read_by() -> None:
    host = SoakHost(embedded_address(os.getpid()), 1)
    host.close()
    calm = pulse([2000] * 100, [8] * 100)
    lines, failed = report(host, [calm, calm], [], 172, 0.03)
    assert (read("\n".join(lines) + "\n"), failed) == ((2, 172, 0), False)
    lines, failed = report(host, [calm, Pulse("writer", 1)], ["the daemon did not stop"], 0, 0.03)
    assert (read("\n".join(lines) + "\n"), failed) == ((1, 0, 2), True)


SAMPLES = [
    LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 14.0),
    LearnedSample(Quantity.STICK_SPEED, 0.081, Direction.OPENING, 0.3, FIT),
    LearnedSample(Quantity.BREAKAWAY_CURRENT, 0.08, Direction.OPENING, 14.5),
]


def entries_of(samples: list[LearnedSample]) -> list[Entry]:
    return [Entry(0, number + 1, sample) for number, sample in enumerate(samples)]


def test_a_table_with_the_fit_of_another_actuator_is_kept_as_the_log_of_its_samples_has_it(tmp_path: Path) -> None:
    """A law that has found another actuator in the middle of a soak teaches its fit with its samples."""
    state, log = tmp_path / "state", tmp_path / "sample_log"
    writer, _, _ = TableWriterClient.open(state, "FV-401", 0.005, timeout_s=60.0)
    written = SampleLogWriter(log)
    for number, sample in enumerate(SAMPLES):
        written.write(number + 1, sample)
        writer.record([sample])
    assert writer.close(60.0) is None

    kept = access.dump(state).table
    assert kept.fit == FIT
    assert difference(kept, taught(StictionTable(), sample_log.read(log))) == ""


@pytest.mark.parametrize(
    ("kept", "words"),
    [
        (SAMPLES[:2], "2 samples are kept, not 3"),
        ([*SAMPLES[:2], replace(SAMPLES[2], value=14.6)], "other samples in CellKey"),
        ([SAMPLES[0], replace(SAMPLES[1], fit=replace(FIT, fill_s=0.1)), SAMPLES[2]], "the fit ValveFit"),
    ],
)
def test_a_table_that_is_not_that_of_the_log_is_told_with_what_differs(kept: list[LearnedSample], words: str) -> None:
    found, expected = (taught(StictionTable(), entries_of(samples)) for samples in (kept, SAMPLES))
    assert difference(found, expected).startswith(words)


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
