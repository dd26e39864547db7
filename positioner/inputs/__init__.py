"""Input written by people: TOML files and names on a command line, with the nearest name for a wrong one."""
