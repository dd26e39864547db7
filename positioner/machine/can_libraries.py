"""python-can and cantools, loaded here for the whole project.

cantools loads python-can, which by itself loads asammdf, where that is installed, and pandas with it: 1.6 s and 120 MB
more in each process, for a format of logs that we do not read. Shell.
"""

from __future__ import annotations

import sys

_HEAVY = "asammdf"

_is_hidden = _HEAVY not in sys.modules
if _is_hidden:
    sys.modules[_HEAVY] = None  # type: ignore[assignment] # an import of it then fails, as python-can expects
try:
    import can
    import cantools.database
finally:
    if _is_hidden:
        del sys.modules[_HEAVY]

__all__ = ["can", "cantools"]
