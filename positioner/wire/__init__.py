"""The wire: typed messages, their DBC and their end-to-end protection. Pure; shared with the plant emulator."""
