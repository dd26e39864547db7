"""The step response test: response times, dead band and resolution of a valve, in closed or in open loop."""
