"""The host on a valve's bus: a person arms, sets, takes over by hand, and sees how it is. `positioner host` runs it."""
