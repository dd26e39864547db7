"""Findings on a CAN interface: is it fit for a control loop? Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from positioner.doctor.finding import Finding, Level

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.doctor.link import Link

LEAST_QUEUE_FRAMES = 128
"""A shorter transmit queue, such as the kernel's default of 10 frames, is full after a few ms of a busy bus."""
RESTART_MS = 100
USUAL_BITRATE = 1_000_000
_SUBJECT = "interface"


def findings(name: str, links: tuple[Link, ...]) -> tuple[Finding, ...]:
    """Return the findings on the interface `name` of this machine, which has the interfaces `links`."""
    link = next((link for link in links if link.name == name), None)
    if link is None:
        others = ", ".join(link.name for link in links if link.is_can)
        text = f"{name} does not exist; " + (f"this machine has {others}" if others else "this machine has no CAN bus")
        return (Finding(Level.FAIL, _SUBJECT, text, _added(name)),)
    if not link.is_can:
        fix = "ip -brief link show type can; ip -brief link show type vcan"
        return (Finding(Level.FAIL, _SUBJECT, f"{name} is no CAN interface: set [bus] channel to one that is", fix),)
    return tuple(_findings(link))


def bring_up(link: Link) -> str:
    """Return the command that brings the interface up, at its own bitrate where it has one."""
    if not link.is_controller:
        return f"sudo ip link set {link.name} up"
    bitrate = link.bitrate or USUAL_BITRATE
    return f"sudo ip link set {link.name} up type can bitrate {bitrate} restart-ms {RESTART_MS}"


def add_vcan(name: str) -> str:
    """Return the command that adds the virtual interface `name` and brings it up."""
    return f"sudo modprobe vcan; sudo ip link add dev {name} type vcan && sudo ip link set {name} up"


def _added(name: str) -> str:
    if name.startswith("vcan"):
        return add_vcan(name)
    return "sudo dmesg | grep -i can  # after plugging in the adapter: does its driver find it?"


def _findings(link: Link) -> Iterator[Finding]:
    yield _presence(link)
    if not link.is_controller:
        return
    yield _queue(link)
    yield _restart(link)
    if link.is_up:
        yield _state(link)
    yield from _modes(link)
    yield from _history(link)


def _presence(link: Link) -> Finding:
    if not link.is_up:
        return Finding(Level.FAIL, _SUBJECT, f"{link.name} is down", bring_up(link))
    if not link.is_controller:
        return Finding(Level.OK, _SUBJECT, f"{link.name} is up ({link.kind or 'virtual'}: no bitrate, no controller)")
    if not link.bitrate:
        text = f"{link.name} is up and reports no bitrate"
        return Finding(Level.WARN, _SUBJECT, text, f"ip -details link show {link.name}")
    point = f", sample point {100 * link.sample_point:.1f} %" if link.sample_point is not None else ""
    return Finding(Level.OK, _SUBJECT, f"{link.name} is up at {link.bitrate / 1000:g} kbit/s{point}")


def _queue(link: Link) -> Finding:
    text = f"{link.queue_frames} frames on {link.name}"
    if link.queue_frames >= LEAST_QUEUE_FRAMES:
        return Finding(Level.OK, "queue", text)
    fix = f"sudo ip link set {link.name} txqueuelen {LEAST_QUEUE_FRAMES}"
    return Finding(Level.WARN, "queue", f"{text}, less than {LEAST_QUEUE_FRAMES}", fix)


def _restart(link: Link) -> Finding:
    if link.restart_ms:
        return Finding(Level.OK, "restart", f"{link.restart_ms} ms after bus-off (restart-ms)")
    text = f"{link.name} stays off the bus after bus-off (restart-ms 0)"
    # the kernel takes a new restart-ms only while the interface is down
    fix = f"sudo ip link set {link.name} down && {bring_up(link)}  # where the driver can (slcan cannot)"
    return Finding(Level.WARN, "restart", text, fix)


def _state(link: Link) -> Finding:
    text = f"{link.name} is {link.state or 'in an unknown state'}"
    if link.error_counters:
        text += f", error counters: transmit {link.error_counters[0]}, receive {link.error_counters[1]}"
    if link.state == "ERROR-ACTIVE":
        return Finding(Level.OK, "controller", text)
    if link.state in {"ERROR-WARNING", "ERROR-PASSIVE"}:
        text += ": check the bitrate of all nodes, and 120 Ω at both ends of the bus"
        return Finding(Level.WARN, "controller", text, f"candump -e {link.name},0:0,#FFFFFFFF  # shows error frames")
    down_and_up = f"sudo ip link set {link.name} down && sudo ip link set {link.name} up"
    return Finding(Level.FAIL, "controller", text, down_and_up)


def _modes(link: Link) -> Iterator[Finding]:
    down = f"sudo ip link set {link.name} down"
    for mode, why in (
        ("LISTEN-ONLY", "no command would be sent"),
        ("ONE-SHOT", "a frame that loses arbitration is not sent again"),
        ("LOOPBACK", "its own frames come back like those of another node"),
    ):
        if mode in link.control_modes:
            off = f"{down} && sudo ip link set {link.name} up type can {mode.lower()} off"
            yield Finding(Level.FAIL, "controller", f"{link.name} is in {mode.lower()} mode: {why}", off)


def _history(link: Link) -> Iterator[Finding]:
    counted = {
        "bus-off": link.totals.get("bus_off", 0),
        "restarts": link.totals.get("restarts", 0),
        "bus errors": link.totals.get("bus_error", 0),
        "error-passive": link.totals.get("error_passive", 0),
        "receive overruns": link.receive_overruns,
    }
    seen = ", ".join(f"{what} {count}" for what, count in counted.items() if count)
    if not seen:
        yield Finding(Level.OK, "bus history", f"no error on {link.name} since its driver was loaded")
        return
    fix = f"ip -details -statistics link show {link.name}  # do the counters still grow?"
    yield Finding(Level.WARN, "bus history", f"{seen} on {link.name} since its driver was loaded", fix)
