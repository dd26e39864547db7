"""An open positioner for sticking control valves: predictive control with a learned stiction table, over CAN."""

__version__ = "0.1.0"
