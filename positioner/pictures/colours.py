"""The one meaning of each colour, for every picture, the report and the live view. Pure.

Plain strings, so that a page and a terminal use them, too. The hues are those of Okabe and Ito and of Tol's `muted`
scheme, a little darker where a line would be too pale on white. Quantities that share a panel differ for every kind of
colour vision, in lightness or in the kind of line, so that they are told apart in grey print, too; a test holds this.
"""

from __future__ import annotations

INK = "#222222"
"""Text and axes."""
FAINT = "#D9D9D9"
"""Grids, and where a dwell ends."""

POSITION = "#0072B2"
"""Position and speed of the stem: the true ones of an emulated valve."""
MEASURED = "#8A8A8A"
"""The readings of the position."""
SETPOINT = "#000000"
"""The setpoint, and the band around it."""
BELIEF = "#C98200"
"""What the law believes: its estimate, and what its model predicts."""
COMMAND = "#4B1D75"
"""The loop current that was commanded, or the controller output."""
BOUND = "#009E73"
"""A bound of the plan: of speed or current, upper or lower."""
BREAKAWAY = "#D55E00"
"""The breakaway current Γ."""
FALLBACK = "#C8102E"
"""Where the law could not do what it wanted, and a dwell that went wrong: the colour of a failure, too."""
TABLE = ("#6B4A1F", "#A98B66", "#DCCBB0")
"""What the stiction table has learned: breakaway currents, stick speeds, landings."""
REFERENCE = "#C3CAD2"
"""An earlier measurement, or what was recorded: broad and pale, below what is compared with it."""
PROCESS_VALUE = "#7F7300"
"""The process value of a loop."""
OPENING, CLOSING = "#0B5351", "#C2567A"
"""The two directions of a stroke."""

MODES = {"HOLD": "#FBE3A6", "FAILSAFE": "#F4B9B0", "SILENT": "#DCD0EE", "": "#E8E8E8"}
"""Shades of the spans in a mode, by its name: pale, below every line; the last one is for every other mode."""

STATUS = {
    "good": "#1A7F37",
    "maintenance-required": "#1D5FC4",
    "out-of-specification": "#F5C400",
    "function-check": "#EE7203",
    "failure": FALLBACK,
    "unknown": "#5B6672",
}
"""The status signals of NAMUR NE 107, and so also what is met, missed and undecided."""

SERIES = ("#332288", "#CC6677", "#44AA99", "#882255", "#999933", "#AA4499", "#117733", "#66B5E0", "#555555")
"""Laws, valves or runs that are compared: in such a picture a colour is one of them, and no quantity."""
MARKS = ("o", "s", "^", "v", "D", "P", "X", "<", ">")
"""The mark of each of them, so that they are told apart without their colours."""


def shade_of(mode: str) -> str:
    """Return the shade of a mode by its name."""
    return MODES.get(mode, MODES[""])
