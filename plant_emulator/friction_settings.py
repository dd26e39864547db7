"""The choice of the friction model, and its parameters beside those of the valve, with their limits. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Interval, Len

from positioner.inputs.table import SettingsTable

_Shares = Annotated[tuple[Annotated[float, Interval(gt=0.0, le=1.0)], ...], Len(1, 20)]
_ROUNDING = 1e-9


class FrictionModel(StrEnum):
    """The equations of the dry friction."""

    KARNOPP = "karnopp"
    LUGRE = "lugre"
    MAXWELL_SLIP = "maxwell-slip"


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionSettings(SettingsTable):
    """The friction model; F_s, F_c, F_v and V_s are those of `[valve]` in each of them.

    With `lugre` and `maxwell-slip` the contact is elastic: a stem that sticks moves by some µm (presliding).
    """

    model: FrictionModel = FrictionModel.KARNOPP
    """"karnopp" (the paper's), "lugre" (Canudas de Wit 1995), or "maxwell-slip" (GMS, Al-Bender 2005)."""
    stiffness_n_per_m: Annotated[float, Interval(ge=1e5, le=1e10)] = 1e8
    """σ_0 of `lugre`; in `maxwell-slip` the sum of the elements' stiffnesses."""
    damping_n_s_per_m: Annotated[float, Interval(ge=0.0, le=1e7)] = 1e4
    """σ_1, damping of the presliding motion; in `maxwell-slip` each element that sticks has its share."""
    element_forces: _Shares = (0.25, 0.25, 0.25, 0.25)
    """α_i of `maxwell-slip`: the share of each element in the friction; together 1."""
    element_stiffnesses: _Shares = (0.67, 0.19, 0.09, 0.05)
    """The share of each element in the stiffness; together 1."""
    attraction_n_per_s: Annotated[float, Interval(ge=1.0, le=1e9)] = 1e5
    """C of `maxwell-slip`: how quickly the friction of a slipping element follows the Stribeck curve."""

    def __post_init__(self) -> None:
        """Check that the shares of the elements belong together.

        Raises:
            ValueError: their numbers differ, or one of the sums is not 1.
        """
        if len(self.element_forces) != len(self.element_stiffnesses):
            raise ValueError("element_forces and element_stiffnesses must have as many values as each other")
        for name, shares in (
            ("element_forces", self.element_forces),
            ("element_stiffnesses", self.element_stiffnesses),
        ):
            if abs(sum(shares) - 1.0) > _ROUNDING:
                raise ValueError(f"{name} must add up to 1, not {sum(shares):g}")
