"""Findings about a valve, computed from records; they command nothing."""
