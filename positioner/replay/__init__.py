"""Replay: a recorded bus through the very same cycle."""
