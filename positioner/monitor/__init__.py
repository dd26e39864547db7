"""The live view: what the frames of a bus or a log show of its valves, in a terminal or on a page. It sends nothing."""
