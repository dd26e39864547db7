"""The LuGre friction model: bristles that deflect, and bend away as the stem slides. Pure.

    F = σ_0·z + σ_1·z' + F_v·v
    z' = v - σ_0·|v|/g(v)·z,   g(v) = F_c + (F_s - F_c)·e^(-(v/V_s)²)

z is the mean deflection of the bristles. C. Canudas de Wit, H. Olsson, K. J. Åström and P. Lischinsky, "A new model for
control of systems with friction", IEEE Transactions on Automatic Control 40 (1995), pp. 419-425, equations 3 to 6.

For a constant velocity the deflection approaches g/σ_0 exponentially, at the rate σ_0·|v|/g. Each short step of
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
        self.fading: float = 1.0
        self.following: float = 1.0

    def contact(self) -> Contact:
        """Return the contact as it is now."""
        return Contact((self.force_n,), (0,))

    def spring_n(self) -> float:
        """Return the force of the bristles in N, positive against opening."""
        return self.force_n

    def resist(self, velocity: float, step_s: float, weight: float) -> None:
        """Set `base_n` and `slope`: in this step the bristles resist by base_n + slope·(velocity of the step)."""
        speed = abs(velocity)
        turns = self.stiffness * speed * step_s / self.limit_n(speed)
        if turns < _SMALL:
            following = 1.0 - turns * (0.5 - turns / 6.0)
            fading = 1.0 - turns * following
        else:
            fading = math.exp(-turns)
            following = (1.0 - fading) / turns
        # over the step z goes from z_0 to z_0·fading + v·h·following
        faded_n = self.force_n * (1.0 - fading)
        damping_s = self.damping / self.stiffness
        self.base_n = self.force_n - weight * faded_n - damping_s * faded_n / step_s
        self.slope = weight * self.stiffness * step_s * following + self.damping * following
        self.fading = fading
        self.following = following

    def slide(self, velocity: float, step_s: float) -> None:
        """Take the bristles to the end of the step, which had this velocity."""
        self.force_n = self.force_n * self.fading + self.stiffness * velocity * step_s * self.following


def friction_n(constants: Constants, stem: Stem, packing: Packing, contact: Contact) -> float:
    """Return the friction on the stem in N, positive against opening motion."""
    moving = LuGreStem(constants, stem, packing, 0.0, None, contact)
    v, spring_n = stem.velocity_m_per_s, moving.force_n
    bending = v - abs(v) * spring_n / moving.limit_n(abs(v))
    return spring_n + moving.damping * bending + moving.viscous * v
