"""The CAN bus: its addresses, how it is opened and kept open, and when a frame arrived. Shell."""
