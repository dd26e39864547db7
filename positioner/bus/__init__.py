"""The CAN bus: its addresses, how it is opened and kept open, and when each frame arrived. Shell."""

from __future__ import annotations

from positioner.machine.can_libraries import can

__all__ = ["can"]
