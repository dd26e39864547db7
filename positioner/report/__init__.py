"""The report of a valve: one HTML page that needs no network, with its figures inside, for the screen and for A4."""
