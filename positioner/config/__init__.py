"""The configuration of one valve: its file, its defaults, and where its state is. Shell."""
