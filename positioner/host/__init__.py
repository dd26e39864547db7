"""The host on a valve's bus, for a person: arm, set, move by hand, see the status. `positioner host` runs it."""
