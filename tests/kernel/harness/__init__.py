"""Kernels of our own for the tests that need SocketCAN, systemd or a CAN controller, where the host has none."""
