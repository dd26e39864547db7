"""Health: what a valve has done and how it changes, counted from the cycles of its positioner."""
