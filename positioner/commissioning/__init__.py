"""Test procedures that move a valve in the daemon's own loop, and what their records show about the valve."""
