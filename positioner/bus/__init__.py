"""The CAN bus: its addresses, how it is opened and kept open, and when each frame arrived. Shell.

python-can is loaded here, for the whole project: `from positioner.bus import can`. By itself it loads asammdf, where
that is installed, and pandas with it: 1.6 s and 120 MB more in each process, for a format of logs that we do not read.
"""

from __future__ import annotations

import sys

_HEAVY = "asammdf"

_is_hidden = _HEAVY not in sys.modules
if _is_hidden:
    sys.modules[_HEAVY] = None  # type: ignore[assignment] # an import of it then fails, as python-can expects
try:
    import can
finally:
    if _is_hidden:
        del sys.modules[_HEAVY]

__all__ = ["can"]
