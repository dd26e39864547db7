"""An open positioner for sticking control valves: predictive control with a learned stiction table, over CAN.

What Python programs call is loaded when it is first asked for (docs/python-api.md).
"""

__version__ = "0.1.0"

__all__ = ["Law", "Log", "PositionerError", "Simulation", "diagnose", "load_log", "simulate"]

TYPE_CHECKING = False  # typing would have to be loaded first; type checkers know the name
if TYPE_CHECKING:
    from positioner.api.recorded import Log, diagnose, load_log
    from positioner.api.simulation import Simulation, simulate
    from positioner.errors import PositionerError
    from positioner.laws.law import Law
else:
    _PLACES = {
        "Law": "positioner.laws.law",
        "Log": "positioner.api.recorded",
        "PositionerError": "positioner.errors",
        "Simulation": "positioner.api.simulation",
        "diagnose": "positioner.api.recorded",
        "load_log": "positioner.api.recorded",
        "simulate": "positioner.api.simulation",
    }

    def __getattr__(name):
        """Load what Python programs call."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        found = getattr(__import__(_PLACES[name], fromlist=(name,)), name)
        globals()[name] = found
        return found

    def __dir__():
        """Return the names that are documented, and those that are there."""
        return sorted({*globals(), *__all__})
