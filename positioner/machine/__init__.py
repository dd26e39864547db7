"""What this machine offers: its clocks, its streams and its log, the service manager. Shell."""
