"""The unit files: what they promise is in them, and where systemd is installed, it agrees."""

from __future__ import annotations

import configparser
import os
import re
import shutil
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from positioner.errors import ExitCode
from positioner.store.child import _START_S

ROOT = Path(__file__).resolve().parents[2]
SYSTEMD = ROOT / "systemd"
SERVICES = ("positioner@.service", "plant-emulator@.service")
UNITS = (*SERVICES, "vcan0.service")
NETWORK = ("80-can.link", "80-can.network", "80-vcan0.netdev", "80-vcan0.network")
OFFLINE_SINCE = 250
MOST_EXPOSURE = 13
"""Tenths: 1.3 on the scale of `systemd-analyze security`, which ends at 10."""
HARDENED = {
    "DynamicUser": "yes",
    "PrivateUsers": "yes",
    "CapabilityBoundingSet": "",
    "AmbientCapabilities": "",
    "NoNewPrivileges": "yes",
    "RestrictAddressFamilies": "AF_CAN AF_UNIX",
    "IPAddressDeny": "any",
    "ProtectSystem": "strict",
    "ProtectHome": "yes",
    "ProtectClock": "yes",
    "ProtectControlGroups": "yes",
    "ProtectHostname": "yes",
    "ProtectKernelLogs": "yes",
    "ProtectKernelModules": "yes",
    "ProtectKernelTunables": "yes",
    "ProtectProc": "invisible",
    "ProcSubset": "pid",
    "PrivateDevices": "yes",
    "PrivateTmp": "yes",
    "DevicePolicy": "closed",
    "KeyringMode": "private",
    "LockPersonality": "yes",
    "MemoryDenyWriteExecute": "yes",
    "RemoveIPC": "yes",
    "RestrictNamespaces": "yes",
    "RestrictRealtime": "yes",
    "RestrictSUIDSGID": "yes",
    "SystemCallArchitectures": "native",
    "SystemCallErrorNumber": "EPERM",
    "UMask": "0027",
}


def read(path: Path) -> dict[tuple[str, str], list[str]]:
    """Return every value of a unit file by section and key; comments are left out."""
    found: dict[tuple[str, str], list[str]] = defaultdict(list)
    section = ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1]
        elif line and not line.startswith("#"):
            key, equals, value = line.partition("=")
            assert equals, line
            found[section, key].append(value)
    return found


def only(unit: dict[tuple[str, str], list[str]], section: str, key: str) -> str:
    (value,) = unit[section, key]
    return value


def analyze(*arguments: str) -> tuple[int, str] | None:
    """Return status and answer of `systemd-analyze`; None where there is none, or one that cannot work offline."""
    if shutil.which("systemd-analyze") is None:
        return None
    version = re.search(r"systemd (\d+)", systemd_analyze("--version")[1])
    if version is None or int(version[1]) < OFFLINE_SINCE:
        return None
    return systemd_analyze(*arguments)


def systemd_analyze(*arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        ["systemd-analyze", *arguments], capture_output=True, text=True, check=False, timeout=120, env=ENGLISH
    )
    return done.returncode, done.stdout + done.stderr


NEWER = re.compile(r"Unknown key( name)? '(RestartSteps|RestartMaxDelaySec)' in section '?\[?Service")
ENGLISH = {**os.environ, "LC_ALL": "C.UTF-8", "SYSTEMD_COLORS": "0", "SYSTEMD_EMOJI": "0"}


@pytest.mark.parametrize("name", SERVICES)
def test_a_service_may_do_only_what_it_needs(name: str) -> None:
    unit = read(SYSTEMD / name)
    assert {key: only(unit, "Service", key) for key in HARDENED} == HARDENED
    assert unit["Service", "SystemCallFilter"] == ["@system-service", "~@privileged @resources"]
    answer = analyze("security", "--offline=true", f"--threshold={MOST_EXPOSURE}", str(SYSTEMD / name))
    if answer is not None:
        status, exposure = answer
        assert status == 0, exposure
        (points,) = re.findall(r"Overall exposure level for \S+: (\d+\.\d)", exposure)
        assert 0.5 <= float(points) <= MOST_EXPOSURE / 10


@pytest.mark.parametrize("name", UNITS)
def test_systemd_understands_every_line(name: str, tmp_path: Path) -> None:
    text = (SYSTEMD / name).read_text(encoding="utf-8")
    # the programs are not installed where tests run, and a template is looked at as one of its instances
    text = text.replace("/opt/positioner/bin/positioner", "/bin/true").replace("/opt/positioner/bin/plant", "/bin/true")
    text = text.replace("/bin/true-emulator", "/bin/true")
    path = tmp_path / name.replace("@", "@fv101")
    path.write_text(text, encoding="utf-8")
    answer = analyze("verify", str(path))
    if answer is not None:  # its status tells of other units of this machine, too
        # what is newer than the systemd of this machine is ignored with a warning
        lines = [line for line in answer[1].splitlines() if path.name in line]
        assert [line for line in lines if not NEWER.search(line)] == []
    sections = {section for section, _ in read(SYSTEMD / name)}
    assert sections == {"Unit", "Service", "Install"}


def test_the_positioner_is_ready_watched_and_restarted_but_not_after_a_wrong_configuration() -> None:
    unit = read(SYSTEMD / "positioner@.service")
    service = {key: values for (section, key), values in unit.items() if section == "Service"}
    assert service["Type"] == ["notify"]
    assert service["NotifyAccess"] == ["main"]
    assert service["ExecStart"] == ["/opt/positioner/bin/positioner run --config /etc/positioner/%i.toml"]
    assert service["StateDirectory"] == ["positioner/%i"]
    assert service["Restart"] == ["on-failure"]
    assert service["RestartPreventExitStatus"] == [f"{ExitCode.UNAVAILABLE:d} {ExitCode.CONFIG:d}"]
    # the loop reports at least ten times a second; a stopped process takes no other signal
    assert 1.0 <= float(service["WatchdogSec"][0]) <= 5.0
    assert service["WatchdogSignal"] == ["SIGKILL"]


def test_what_comes_before_the_first_cycle_of_the_loop_has_an_end() -> None:
    # longer than the daemon waits for its table writer; each turn before the first feedback extends it
    assert 2 * _START_S <= float(only(read(SYSTEMD / "positioner@.service"), "Service", "TimeoutStartSec")) <= 120.0


def test_a_positioner_that_crashes_again_and_again_is_restarted_later_and_later_and_never_given_up() -> None:
    unit = read(SYSTEMD / "positioner@.service")
    assert only(unit, "Service", "RestartSec") == "200ms"  # the first time
    assert 5 <= int(only(unit, "Service", "RestartSteps")) <= 20
    # systemd does not forget how often it has restarted: a longer one would delay a restart after years
    assert 1.0 <= float(only(unit, "Service", "RestartMaxDelaySec")) <= 10.0
    assert only(unit, "Unit", "StartLimitIntervalSec") == "0"


def test_the_memory_of_the_positioner_is_bounded_and_may_be_locked() -> None:
    unit = read(SYSTEMD / "positioner@.service")
    assert only(unit, "Service", "MemoryMax") == "512M"
    assert only(unit, "Service", "LimitMEMLOCK") == "infinity"


def test_real_time_is_an_option_that_is_commented_and_a_drop_in() -> None:
    text = (SYSTEMD / "positioner@.service").read_text(encoding="utf-8")
    drop_in = read(SYSTEMD / "realtime.conf")
    for key in ("CPUSchedulingPolicy", "CPUSchedulingPriority", "CPUSchedulingResetOnFork", "TimerSlackNSec"):
        assert f"\n#{key}={only(drop_in, 'Service', key)}\n" in text
    assert "\n#CPUAffinity=1\n" in text
    assert not any(key.startswith("CPU") for _, key in read(SYSTEMD / "positioner@.service"))


def test_the_drop_in_binds_a_service_to_its_interface_and_the_interface_to_it() -> None:
    unit = read(SYSTEMD / "bus.conf")
    device = "sys-subsystem-net-devices-can0.device"
    assert dict(unit) == {("Unit", "BindsTo"): [device], ("Unit", "After"): [device], ("Install", "WantedBy"): [device]}


def test_the_emulator_takes_its_plant_bus_and_period_from_beside_the_valve() -> None:
    unit = read(SYSTEMD / "plant-emulator@.service")
    assert only(unit, "Service", "EnvironmentFile") == "-/etc/positioner/plant-%i.env"
    assert only(unit, "Service", "ExecStart") == (
        "/opt/positioner/bin/plant-emulator run --config /etc/positioner/plant-%i.toml"
        " --bus ${BUS} --period ${PERIOD} $OPTIONS"
    )
    assert "BUS=socketcan:vcan0 PERIOD=0.001 OPTIONS=" in unit["Service", "Environment"]
    assert only(unit, "Service", "Type") == "notify"


@pytest.mark.parametrize("name", NETWORK)
def test_network_files_are_well_formed_and_say_where_they_go(name: str) -> None:
    path = SYSTEMD / "network" / name
    parser = configparser.ConfigParser(strict=True)
    parser.read(path, encoding="utf-8")
    assert "NetDev" in parser or "Match" in parser
    assert path.read_text(encoding="utf-8").startswith("# ")


def test_a_controller_gets_bitrate_restart_and_a_queue_of_128_frames() -> None:
    network, link = read(SYSTEMD / "network" / "80-can.network"), read(SYSTEMD / "network" / "80-can.link")
    assert only(network, "Match", "Name") == only(link, "Match", "OriginalName") == "can*"
    assert only(network, "CAN", "BitRate") == "1M"
    assert only(network, "CAN", "RestartSec") == "100ms"
    assert only(link, "Link", "TransmitQueueLength") == "128"
    rules = (SYSTEMD / "network" / "90-usb-can.rules").read_text(encoding="utf-8")
    assert 'ATTR{type}=="280"' in rules  # ARPHRD_CAN


def test_the_virtual_bus_is_made_by_a_unit_or_by_networkd() -> None:
    netdev = read(SYSTEMD / "network" / "80-vcan0.netdev")
    assert (only(netdev, "NetDev", "Name"), only(netdev, "NetDev", "Kind")) == ("vcan0", "vcan")
    unit = read(SYSTEMD / "vcan0.service")
    assert "ip link add dev vcan0 type vcan" in unit["Service", "ExecStart"][0]
    assert only(unit, "Service", "RemainAfterExit") == "yes"
