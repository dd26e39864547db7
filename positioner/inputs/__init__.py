"""What people write: TOML files and names on a command line, with the nearest name for a wrong one."""
