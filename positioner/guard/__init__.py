"""The guard: modes, arming, stalls, manual mode, and the last word on the current. Pure."""
