"""Stiction from the command and the stem position."""
