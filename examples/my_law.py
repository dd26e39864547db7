"""A law of one's own: `positioner league --short --laws nmpc,examples/my_law.py:MyLaw` (docs/own-law.md)."""


class MyLaw:
    """The current that balances the spring at the setpoint, and an integral of the error."""

    tuned = {"gain_ma_per_m_s": (50.0, 50000.0)}

    def __init__(self, parts, gain_ma_per_m_s=800.0):
        """Keep the valve and the gain; `positioner tune` finds a better one in this range."""
        self.valve, self.gain = parts.valve, gain_ma_per_m_s

    def begin(self, measured_m):
        """Return the first memory: the integral of the error in mA."""
        return 0.0

    def decide(self, memory, stem, observation, table):
        """Return the memory and the current in mA."""
        memory += self.gain * (observation.setpoint_m - stem.position_m) * observation.elapsed_s
        return memory, self.valve.balance_current_ma(observation.setpoint_m) + memory
