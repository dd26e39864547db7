"""The daemon: it waits for frames, runs the cycle, and sends, records and tells what came of it. Shell."""
