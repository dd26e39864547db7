"""The metrics of a daemon in the OpenMetrics text format, written by a process of their own."""
