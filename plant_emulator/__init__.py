"""A sticking control valve on a CAN bus: Karnopp friction, simulated event by event.

The emulator shares messages, bus port and settings reader with the positioner, but no line of physics: a plant that
copied the model of its controller would hide the errors of that model.
"""
