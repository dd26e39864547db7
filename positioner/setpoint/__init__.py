"""Setpoint functions: what becomes of the host's setpoint before a law pursues it. All are off by default."""
