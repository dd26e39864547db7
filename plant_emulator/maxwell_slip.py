"""The generalised Maxwell-slip model (GMS): elements side by side, each sticks on its spring or slips. Pure.

    sticking:  F_i' = k_i·v,  until |F_i| = α_i·s(v)
    slipping:  F_i' = sgn(v)·C·(α_i - F_i/s(v)),  until v changes its sign
    F = Σ F_i + Σ σ_i·v of those that stick + F_v·v,   s(v) = sgn(v)·[F_c + (F_s - F_c)·e^(-(v/V_s)²)]

F. Al-Bender, V. Lampaert and J. Swevers, "The generalized Maxwell-slip model: a novel model for friction simulation and
compensation", IEEE Transactions on Automatic Control 50 (2005), pp. 1883-1887. The damping σ_i of a sticking element,
its share of the stiffness times σ_1, is that of LuGre's bristles; without it a stem that sticks rings like a bell.

The elements give presliding hysteresis with a non-local memory: a closed inner loop is forgotten. For a constant
velocity a sticking element is a spring, and the force of a slipping one approaches α_i·s(v) exponentially, at the rate
C/|s|. Each step of `contact` takes these solutions. An element that reaches its limit inside a step is held
there.
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


class MaxwellSlipStem(ContactStem):
    """A stem on Maxwell-slip elements."""

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
        settings = constants.settings.friction
        self.damping = settings.damping_n_s_per_m
        self.attraction: float = settings.attraction_n_per_s
        self.shares: list[float] = list(settings.element_forces)
        self.springs: list[float] = [share * settings.stiffness_n_per_m for share in settings.element_stiffnesses]
        self.forces: list[float] = list(contact.forces_n)
        self.slipping: list[int] = list(contact.slipping)
        self.ends: list[float] = list(contact.forces_n)
        self.reached: list[int] = list(contact.slipping)
        self.velocity: float = 0.0
        self.step_s: float = 0.0

    def contact(self) -> Contact:
        """Return the contact as it is now."""
        return Contact(tuple(self.forces), tuple(self.slipping))

    def spring_n(self) -> float:
        """Return the force of the elements in N, positive against opening."""
        total_n = 0.0
        for force_n in self.forces:
            total_n += force_n
        return total_n

    def resist(self, velocity: float, step_s: float, weight: float) -> None:
        """Set `base_n` and `slope`: in this step the elements resist by base_n + slope·(velocity of the step)."""
        way = (velocity > 0.0) - (velocity < 0.0)
        limit = self.limit_n(abs(velocity))
        fading = math.exp(-self.attraction * step_s / limit)
        advance = velocity * step_s
        sticks = weight * step_s + self.damping / self.stiffness
        base, slope = 0.0, 0.0
        for i in range(len(self.forces)):
            start = self.forces[i]
            spring = self.springs[i]
            bound = way * self.shares[i] * limit
            end = start + spring * advance
            if way != 0 and self.slipping[i] == way:
                end = bound + (start - bound) * fading
            elif way * (end - bound) <= 0.0:
                self.ends[i] = end
                self.reached[i] = 0
                base += start
                slope += spring * sticks
                continue
            else:
                # beyond its limit before the step is only an element that a stronger packing has left there
                end = bound if way * (start - bound) <= 0.0 else bound + (start - bound) * fading
            self.ends[i] = end
            self.reached[i] = way
            base += start + weight * (end - start)
        self.base_n = base
        self.slope = slope
        self.velocity = velocity
        self.step_s = step_s

    def resistance_n(self, velocity: float) -> float:
        """Return the dry friction in N at this velocity, positive against opening, as the elements are now."""
        total_n = 0.0
        for i in range(len(self.forces)):
            total_n += self.forces[i]
            if self.slipping[i] * velocity <= 0.0:  # it sticks, or will at once
                total_n += self.damping * self.springs[i] / self.stiffness * velocity
        return total_n

    def restore(self, contact: Contact) -> None:
        """Go back to `contact`."""
        self.forces = list(contact.forces_n)
        self.slipping = list(contact.slipping)

    def slide(self, velocity: float) -> None:
        """Take the elements to the end of the step that `resist` was told last, which had this velocity."""
        more_m = (velocity - self.velocity) * self.step_s
        for i in range(len(self.forces)):
            reached = self.reached[i]
            self.forces[i] = self.ends[i] if reached else self.ends[i] + self.springs[i] * more_m
            self.slipping[i] = reached


def friction_n(constants: Constants, stem: Stem, packing: Packing, contact: Contact) -> float:
    """Return the friction on the stem in N, positive against opening motion."""
    moving = MaxwellSlipStem(constants, stem, packing, 0.0, None, contact)
    v = stem.velocity_m_per_s
    return moving.resistance_n(v) + moving.viscous * v
