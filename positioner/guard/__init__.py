"""The guard: modes, arming, stalls, manual mode, and the final limit of the current. Pure."""
