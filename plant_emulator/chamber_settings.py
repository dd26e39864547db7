"""The parameters of a chamber with mass flow, with their limits; SI units. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Interval

from positioner.inputs.table import SettingsTable


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberSettings(SettingsTable):
    """The chamber behind a spool, for `[actuator] model = "mass-flow"`; `actuator.supply_pa` fills it."""

    fill_conductance_m3_per_s_pa: Annotated[float, Interval(ge=1e-12, le=1e-4)] = 1e-8
    """C of the open spool from the supply to the chamber, sonic conductance of ISO 6358."""
    vent_conductance_m3_per_s_pa: Annotated[float, Interval(ge=1e-12, le=1e-4)] = 1e-8
    """C of the open spool from the chamber to the atmosphere."""
    critical_pressure_ratio: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.5
    """b of ISO 6358: below this ratio of the pressures behind and before the spool its flow is choked."""
    dead_volume_m3: Annotated[float, Interval(ge=1e-6, le=1.0)] = 1e-3
    """V_0, volume of chamber and air line at the lower stop."""
    opening_pa: Annotated[float, Interval(ge=1.0, le=1e6)] = 1e4
    """Difference of the commanded pressure from that in the chamber at which the spool is fully open."""
    polytropic_index: Annotated[float, Interval(ge=1.0, le=1.4)] = 1.0
    """n of the air in the chamber: 1 is isothermal, 1.4 adiabatic."""
    double_acting: bool = False
    """A second chamber opposes the first one: as much as the command raises the one, it lowers the other."""
    opposing_dead_volume_m3: Annotated[float, Interval(ge=1e-6, le=1.0)] = 1e-3
    """Volume of the opposing chamber and its air line at the upper stop."""
