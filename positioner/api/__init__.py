"""What Python programs and notebooks call: `from positioner import simulate, load_log, diagnose`."""
