"""The CAN bus: its addresses, how it is opened and kept open, and when each frame arrived. Shell."""
