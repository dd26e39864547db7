"""The partial stroke test: its settings, its procedure, and what its record shows. Pure."""
