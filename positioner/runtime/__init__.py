"""The daemon: it waits for frames, runs the cycle, sends its frames, and records and reports its events. Shell."""
