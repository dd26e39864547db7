"""A sticking control valve on a CAN bus: Karnopp friction, simulated event by event.

The emulator shares the wire and the plumbing (bus port, settings reader, errors) with the positioner, and no line of
physics: a plant that copied its controller's model would hide that model's errors.
"""
