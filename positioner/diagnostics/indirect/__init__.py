"""Stiction from controller output and process value of a loop: the published methods, side by side."""
