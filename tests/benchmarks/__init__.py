"""Speed: one cycle, one plan beside those of other programs, a frame's way through the daemon, and a simulation.

`make benchmark` measures all of it in one run and writes out/benchmark. Nothing here asserts a time: times depend on
the machine.
"""
