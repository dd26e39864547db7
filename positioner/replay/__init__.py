"""Replay: the frames of a recorded bus are given to the same control cycle."""
