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
        self.dampings: list[float] = [self.damping * spring / self.stiffness for spring in self.springs]
        self.forces: list[float] = list(contact.forces_n)
        self.slipping: list[int] = list(contact.slipping)
        self.forces_before: list[float] = list(contact.forces_n)
        self.slipping_before: list[int] = list(contact.slipping)
        self.velocity: float = 0.0
        self.step_s: float = 0.0
        self.way: int = 0
        self.limit: float = 0.0
        self.fading: float = 0.0

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
        self.velocity = velocity
        self.step_s = step_s
        self.way = (velocity > 0.0) - (velocity < 0.0)
        self.limit = self.limit_n(abs(velocity))
        self.fading = math.exp(-self.attraction * step_s / self.limit)
        sticks = weight * step_s + self.damping / self.stiffness
        base, slope = 0.0, 0.0
        for i in range(len(self.forces)):
            start = self.forces[i]
            end, slips = self._end(i)
            if slips:
                base += start + weight * (end - start)
            else:
                base += start
                slope += self.springs[i] * sticks
        self.base_n = base
        self.slope = slope

    def _end(self, i: int) -> tuple[float, int]:
        """Return the force in N of an element at the end of the step that `resist` was told, and where it slips to."""
        start, way = self.forces[i], self.way
        bound = way * self.shares[i] * self.limit
        if way != 0 and self.slipping[i] == way:
            return bound + (start - bound) * self.fading, way
        end = start + self.springs[i] * (self.velocity * self.step_s)
        if way * (end - bound) <= 0.0:
            return end, 0
        # beyond its limit before the step is only an element that a stronger packing has left there
        return (bound if way * (start - bound) <= 0.0 else bound + (start - bound) * self.fading), way

    def resistance_n(self, velocity: float) -> float:
        """Return the dry friction in N at this velocity, positive against opening, as the elements are now."""
        total_n = 0.0
        for i in range(len(self.forces)):
            total_n += self.forces[i]
            if self.slipping[i] * velocity <= 0.0:  # it sticks, or will at once
                total_n += self.dampings[i] * velocity
        return total_n

    def restore(self) -> None:
        """Go back to before the last `slide`."""
        self.forces, self.forces_before = self.forces_before, self.forces
        self.slipping, self.slipping_before = self.slipping_before, self.slipping

    def slide(self, velocity: float) -> None:
        """Take the elements to the end of the step that `resist` was told last, which had this velocity."""
        more_m = (velocity - self.velocity) * self.step_s
        forces, slipping = self.forces_before, self.slipping_before
        for i in range(len(forces)):
            end, slips = self._end(i)
            forces[i] = end if slips else end + self.springs[i] * more_m
            slipping[i] = slips
        self.forces, self.forces_before = forces, self.forces
        self.slipping, self.slipping_before = slipping, self.slipping


def friction_n(constants: Constants, stem: Stem, packing: Packing, contact: Contact) -> float:
    """Return the friction on the stem in N, positive against opening motion."""
    moving = MaxwellSlipStem(constants, stem, packing, 0.0, None, contact)
    v = stem.velocity_m_per_s
    return moving.resistance_n(v) + moving.viscous * v
