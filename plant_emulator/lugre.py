"""The LuGre friction model: bristles that deflect, and bend away as the stem slides. Pure.

    F = σ_0·z + σ_1·z' + F_v·v
    z' = v - σ_0·|v|/g(v)·z,   g(v) = F_c + (F_s - F_c)·e^(-(v/V_s)²)

z is the mean deflection of the bristles. C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, "A new model for
control of systems with friction", IEEE Transactions on Automatic Control 40 (1995), pp. 419-425, equations 3 to 6.

For a constant velocity the deflection approaches g/σ_0 exponentially, at the rate σ_0·|v|/g. Each step of
`contact` takes this solution.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from plant_emulator.contact import Contact, ContactStem

if TYPE_CHECKING:
    from plant_emulator.constants import Constants
    from plant_emulator.feedback import Feedback
    from plant_emulator.friction import Packing
    from plant_emulator.stem import Stem

_SMALL = 1e-3
"""Below it three terms of a power series give e^-y and (1 - e^-y)/y to eleven digits."""


class LuGreStem(ContactStem):
    """A stem on bristles."""

    def __init__(
        self,
        constants: Constants,
        stem: Stem,
        packing: Packing,
        time_s: float,
        feedback: Feedback | None,
        contact: Contact,
    ) -> None:
        """Begin at `stem` and `contact`; `time_s` is the plant time."""
        super().__init__(constants, stem, packing, time_s, feedback)
        self.damping = constants.settings.friction.damping_n_s_per_m
        self.force_n: float = contact.forces_n[0]
        self.before_n: float = self.force_n
        self.velocity: float = 0.0
        self.end_n: float = 0.0
        self.steep: float = 0.0

    def contact(self) -> Contact:
        """Return the contact as it is now."""
        return Contact((self.force_n,), (0,))

    def spring_n(self) -> float:
        """Return the force of the bristles in N, positive against opening."""
        return self.force_n

    def resist(self, velocity: float, step_s: float, weight: float) -> None:
        """Set `base_n` and `slope`: in this step the bristles resist by base_n + slope·(velocity of the step)."""
        speed = abs(velocity)
        limit_n = self.limit_n(speed)
        turns = self.stiffness * speed * step_s / limit_n
        if turns < _SMALL:
            following = 1.0 - turns * (0.5 - turns / 6.0)
            fading = 1.0 - turns * following
            part = (0.5 - turns / 6.0) / following
        else:
            fading = math.exp(-turns)
            following = (1.0 - fading) / turns
            part = (1.0 - following) / (1.0 - fading)
        # the mean of the force over the step: this part of the way from its start to its end, half where that is slow
        weight = max(weight, part)
        way = (velocity > 0.0) - (velocity < 0.0)
        # the force at the end of a step with this velocity, and how it grows with the velocity
        end_n = self.force_n * fading + self.stiffness * velocity * step_s * following
        steep = self.stiffness * step_s * fading * (1.0 - way * self.force_n / limit_n)
        self.velocity = velocity
        self.end_n = end_n
        self.steep = steep
        counts = weight + self.damping / (self.stiffness * step_s)
        self.base_n = self.force_n + counts * (end_n - steep * velocity - self.force_n)
        self.slope = counts * steep

    def resistance_n(self, velocity: float) -> float:
        """Return the dry friction in N at this velocity, positive against opening, as the bristles are now."""
        speed = abs(velocity)
        return self.force_n + self.damping * (velocity - speed * self.force_n / self.limit_n(speed))

    def restore(self) -> None:
        """Go back to before the last `slide`."""
        self.force_n = self.before_n

    def slide(self, velocity: float) -> None:
        """Take the bristles to the end of the step that `resist` was told last, which had this velocity."""
        self.before_n = self.force_n
        self.force_n = self.end_n + self.steep * (velocity - self.velocity)


def friction_n(constants: Constants, stem: Stem, packing: Packing, contact: Contact) -> float:
    """Return the friction on the stem in N, positive against opening motion."""
    moving = LuGreStem(constants, stem, packing, 0.0, None, contact)
    v = stem.velocity_m_per_s
    return moving.resistance_n(v) + moving.viscous * v
