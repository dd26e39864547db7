"""The examination: the machine, and with a configuration also bus, state, daemon and feedback of its valve. Shell."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from positioner.config.locations import location_of
from positioner.config.reader import load_valves
from positioner.config.several import by_bus
from positioner.doctor import (
    bus_load,
    cycle_time,
    feedback,
    link_findings,
    machine,
    real_time,
    scheduling,
    state_directory,
)
from positioner.doctor.finding import Finding, Level, worst
from positioner.errors import ConfigurationError, ExitCode
from positioner.reach.expected import in_words
from positioner.store import lock
from positioner.wire.messages import StemPosition

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from positioner.config.schema import Configuration
    from positioner.doctor.link import Link


@dataclass(slots=True)
class Examination:
    """An examination; `exit_code` is valid after the last of the `findings`."""

    config: Path | None
    state: Path | None = None
    found: list[Finding] = field(default_factory=list)
    _misconfigured: bool = False

    @property
    def exit_code(self) -> ExitCode:
        """78 where the configuration is wrong, 1 where any other finding is FAIL, else 0."""
        if self._misconfigured:
            return ExitCode.CONFIG
        return ExitCode.FAILURE if worst(self.found) is Level.FAIL else ExitCode.OK

    def findings(self) -> Iterator[Finding]:
        """Yield each finding as soon as it is known."""
        for finding in self._examine():
            self.found.append(finding)
            yield finding

    def _examine(self) -> Iterator[Finding]:
        yield machine.timer()
        yield machine.sqlite()
        yield machine.build()
        yield scheduling.of_this_command()
        configurations: tuple[Configuration, ...] = ()
        if self.config is not None:
            quoted = shlex.quote(str(self.config))
            try:
                configurations = load_valves(self.config)
            except ConfigurationError as error:
                self._misconfigured = True
                for problem in error.problems:
                    yield Finding(Level.FAIL, "configuration", str(problem), f"positioner check {quoted}")
            else:
                names = ", ".join(configuration.valve.id for configuration in configurations)
                yield Finding(Level.OK, "configuration", f"{self.config}, valve {names}")
        links, missing = machine.links()
        yield from missing
        if not configurations or self.config is None:
            yield from cycle_time.of_any_valve()
            yield from _interfaces(links) if links is not None else ()
            return
        for configuration in configurations:
            if len(configurations) > 1:
                yield Finding(Level.OK, "valve", f"{configuration.valve.id}:")
            yield Finding(Level.OK, "DBC", _frames(configuration))
            yield from _law(configuration, self.config)
            yield from cycle_time.findings(configuration, self.config)
            yield from self._valve(configuration, self.config, links)
        yield from _shared_buses(configurations, links or ())

    def _valve(self, configuration: Configuration, path: Path, links: tuple[Link, ...] | None) -> Iterator[Finding]:
        address, period_s = configuration.bus, configuration.control.sample_period_s
        codec, place = configuration.make_codec(), location_of(configuration, path, self.state)
        if address.interface != "socketcan":
            yield Finding(Level.OK, "interface", f"{address} is not a CAN interface: no bitrate, no error counters")
        elif links is not None:
            yield from link_findings.findings(address.channel, links)
            link = next((link for link in links if link.name == address.channel), None)
            if link is not None and link.is_can and (link.bitrate or not link.is_controller):
                yield from bus_load.findings(codec, period_s, address.channel, link.bitrate, shlex.quote(str(path)))
        yield from state_directory.findings(configuration, place)
        pid = lock.holder(place.state)
        yield scheduling.of_daemon(pid, period_s, place.unit)
        if period_s < scheduling.SLOW_ENOUGH_S:
            yield from real_time.of_machine()
            yield from real_time.of_daemon(pid, place.unit)
        yield from feedback.findings(address, codec, period_s, daemon_runs=pid is not None)


def _shared_buses(configurations: Sequence[Configuration], links: tuple[Link, ...]) -> Iterator[Finding]:
    """Yield the load of each bus that several valves share."""
    for some in by_bus(configurations):
        link = next((link for link in links if link.name == some[0].bus.channel), None)
        if len(some) > 1 and link is not None and link.bitrate:
            valves = [(each.make_codec(), each.control.sample_period_s) for each in some]
            yield bus_load.of_several(link.name, valves, link.bitrate)


def _interfaces(links: tuple[Link, ...]) -> Iterator[Finding]:
    names = [link.name for link in links if link.is_can]
    for name in names:
        for finding in link_findings.findings(name, links):
            # no configuration needs this interface, as far as is known
            yield replace(finding, level=min(finding.level, Level.WARN))
    if not names:
        fix = f"{link_findings.add_vcan('vcan0')}  # a virtual one, for tests"
        yield Finding(Level.WARN, "interface", "this machine has no CAN interface", fix)


def _law(configuration: Configuration, path: Path) -> Iterator[Finding]:
    """Yield the error to expect of the law on this valve, and whether its period fits."""
    error, why = in_words(configuration)
    if why:
        fix = f"positioner reach --config {shlex.quote(str(path))}  # what would help"
        yield Finding(Level.WARN, "error", f"{error}: {why}", fix)
    elif error:
        yield Finding(Level.OK, "error", error)


def _frames(configuration: Configuration) -> str:
    identifier, extended = configuration.make_codec().identifier(StemPosition)
    shown = f"{identifier:08X} (extended)" if extended else f"{identifier:03X}"
    source = configuration.wire.dbc or "the positioner's own"
    return f"{source}, position frames have the identifier {shown}"
