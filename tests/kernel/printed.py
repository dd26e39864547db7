"""What the tests in kernels and packages look for on screens: each text stands in what the product itself prints.

Such a test takes minutes, and CI leaves many of them out. So a text that the product prints no more must not wait for
it: importing this module checks all of them, and `tests/project/test_kernel_texts.py` does so in `make test`.
"""

from __future__ import annotations

from pathlib import Path

from link_answers import PEAK_USB

from plant_emulator.device import failure, initial_device
from plant_emulator.presets import plant_settings, preset_names
from positioner.bench.modes import ModeSpan, mode_lines
from positioner.bench.runner import ON_VCAN
from positioner.bus.address import BusAddress
from positioner.bus.events import BusBack, BusDown, Overrun, SendFailed
from positioner.cli.check import verdict
from positioner.cycle.events import FeedbackRefused, ForeignCommand, FrameRefused, ModeChanged
from positioner.doctor.finding import Finding, Level, summary
from positioner.doctor.link import parse_links
from positioner.doctor.link_findings import findings
from positioner.host.snapshot import Snapshot
from positioner.inputs.nearest import did_you_mean
from positioner.laws.registry import LAWS
from positioner.runtime.daemon import STOPPED
from positioner.runtime.shared_bus import WAITING
from positioner.values import replace
from positioner.wire.messages import Cause, Counted, Health, Mode, PositionerStatus, Quality

_BUS = BusAddress(channel="can0")
_ACTIVE, _HOLD, _FAILSAFE = Mode.ACTIVE, Mode.HOLD, Mode.FAILSAFE


def of(*lines: object, text: str) -> str:
    """Return `text`, which stands in each of these lines of the product.

    Raises:
        ValueError: it does not: a kernel test would look for it in vain.
    """
    for line in lines:
        if text not in str(line):
            raise ValueError(f"kernel tests look for {text!r}, and the product prints {str(line)!r}")
    return text


# the log of the positioner
LOST = of(Counted.LOST.text, text="lost")
REPEATED = of(Counted.REPEATED.text, text="repeated")
OUT_OF_ORDER = of(Counted.OUT_OF_ORDER.text, text="order")
WRONG_CRC = of(Counted.WRONG_CRC.text, text="wrong CRC")
WRONG = of(Counted.WRONG_CRC.text, Counted.WRONG_LENGTH.text, text="wrong")
REFUSED = of(
    FrameRefused(counted=Counted.WRONG_CRC, detail=""),
    FeedbackRefused(counted=Counted.FEEDBACK_RANGE, position_m=0.0, why=""),
    text="refused",
)
MODE = of(ModeChanged(_ACTIVE, _HOLD, Cause.NONE), text="mode ")
INTO_FAILSAFE = of(
    ModeChanged(_HOLD, _FAILSAFE, Cause.NONE), ModeChanged(_ACTIVE, _FAILSAFE, Cause.NONE), text="-> FAILSAFE"
)
HELD_BY_FEEDBACK = of(ModeChanged(_ACTIVE, _HOLD, Cause.FEEDBACK_STALE), text="ACTIVE -> HOLD (feedback stale)")
BUS_DOWN = of(BusDown(_BUS, ""), text="is down")
BUS_BACK = of(BusBack(_BUS), text="is there again")
NOT_TAKEN = of(SendFailed(_BUS, ""), text="did not take a frame")
QUEUE_FULL = of(Overrun(_BUS, 1), text="queue was full")


def foreign(current_ma: float) -> str:
    """Return how the log names the current of another controller."""
    return of(ForeignCommand(current_ma=current_ma), text=f"{current_ma:.3f} mA")


# the service
STOPPED_AND_SAVED = of(STOPPED, text="stopped; the stiction table is saved")
WAITING_FOR_FRAMES = of(WAITING, text="waiting for position frames")
DID_YOU_MEAN = did_you_mean("nmcp", LAWS).strip()
_PLANT = plant_settings("paper")
FAIL_POSITION = of(failure(_PLANT, replace(initial_device(_PLANT, 1), failed=True)), text="fail position 'close'")

# the doctor
_CAN1 = [finding.text for finding in findings("can1", parse_links(PEAK_USB))]
NOTHING_FAILS = of(summary([Finding(Level.OK, "", ""), Finding(Level.WARN, "", "")]), text="0 FAIL, ")
"""What the summary of an examination begins with in which nothing fails."""
UP_AT_1000 = of(" ".join(_CAN1), text="is up at 1000 kbit/s")
RESTARTS = of(" ".join(_CAN1), text="100 ms after bus-off")
ERROR_ACTIVE = of(" ".join(_CAN1), text="can1 is ERROR-ACTIVE").removeprefix("can1 ")

# the bench
FOUND_VCAN = of(ON_VCAN, text="a virtual CAN interface of this machine")

# the package
PRESET = of(" ".join(preset_names()), text="paper")
CHECKED = of(verdict(Path("valve.toml"), 0), text="valve.toml: good")
ALWAYS_ACTIVE = of(mode_lines([ModeSpan(_ACTIVE, Cause.NONE, 0.0, 1.5)])[0], text="ACTIVE 100 %")
_STATUS = PositionerStatus(
    mode=_ACTIVE,
    cause=Cause.NONE,
    health=Health.GOOD,
    armed=True,
    table_saved=True,
    fallback_count=0,
    rejected_count=0,
    learned_count=0,
)
_SHOWN = Snapshot("fv101", 0.127, _STATUS, None, Quality.VALID, None, None, None, {})
ARMED = of("\n".join(_SHOWN.lines(_STATUS)), text="armed     yes")
"""A whole line of `status`."""
_PREINST = Path(__file__).resolve().parents[2] / "building" / "debian" / "preinst"
UNINSTALL_FIRST = of(_PREINST.read_text(encoding="utf-8"), text="first: sudo make uninstall")

# other programs
TRACEBACK = "Traceback"
STATE_UP, BITRATE_1M, QUEUE_128 = "state UP", "bitrate 1000000", "qlen 128"
EXPOSURE = "Overall exposure level"
NO_BUFFER_SPACE = "No buffer space"
WATCHDOG = "Watchdog timeout"
START_TIMED_OUT = "start operation timed out"
