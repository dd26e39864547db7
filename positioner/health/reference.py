"""What later friction is compared with: the valve as `identify` or `signature` measured it, with its date. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.valve.parameters import ValveParameters

CONFIGURED = "configuration"
"""The source of a reference that nobody measured."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Spring rate K, its force F_0 at position 0, F_c and F_s in SI units.

    source: the kind of test procedure, or `CONFIGURED`; recorded: its date, empty without one.
    by_place: places in m, rising, and F_c there; empty where it was not measured by place.
    closed_m, open_m: the stops. span_m: 100 % of travel. response_s: T86 of a step test, 0 where there is none.
    """

    source: str
    recorded: str
    spring_n_per_m: float
    preload_n: float
    sliding_n: float
    static_n: float
    by_place: tuple[tuple[float, float], ...]
    closed_m: float
    open_m: float
    span_m: float
    response_s: float = 0.0

    @classmethod
    def configured(cls, valve: ValveParameters) -> Reference:
        """Return the valve as it is configured."""
        return cls(
            CONFIGURED,
            "",
            valve.spring_rate_n_per_m,
            valve.bench_set_n,
            valve.coulomb_friction_n,
            valve.static_friction_n,
            (),
            valve.travel_min_m,
            valve.travel_max_m,
            valve.span_m,
        )

    def balance_n(self, position_m: float) -> float:
        """Return the force of the spring at a place, in N."""
        return self.preload_n + self.spring_n_per_m * position_m

    def sliding_along_n(self, from_m: float, to_m: float) -> float:
        """Return the mean F_c in N along a way: of the places on it, or of the one nearest to its middle."""
        if not self.by_place:
            return self.sliding_n
        low_m, high_m = min(from_m, to_m), max(from_m, to_m)
        total_n, count, middle_m = 0.0, 0, 0.5 * (low_m + high_m)
        nearest = self.by_place[0]
        for place in self.by_place:
            if low_m <= place[0] <= high_m:
                total_n, count = total_n + place[1], count + 1
            if abs(place[0] - middle_m) < abs(nearest[0] - middle_m):
                nearest = place
        return total_n / count if count else nearest[1]

    def static_at_n(self, position_m: float) -> float:
        """Return F_s in N at a place: as much more than the mean as F_c is there."""
        return self.static_n * self.sliding_along_n(position_m, position_m) / self.sliding_n


def reference_of(
    valve: ValveParameters,
    identified: tuple[str, Mapping[str, Any]] | None = None,
    signature: tuple[str, Mapping[str, Any]] | None = None,
) -> Reference:
    """Return the reference from the kept results, each with its date: from a signature, or else an identification.

    Without either it is the configured valve. What a result does not show is as configured.

    Raises:
        KeyError, TypeError, ValueError: a document is not what its procedure writes.
    """
    bare = Reference.configured(valve)
    if signature is not None:
        recorded, document = signature
        values = document["quantities"]
        preload_n = next(float(row["value"]) for row in document["rows"] if row["name"] == "spring force at 0")
        places = tuple(sorted((float(x), float(f)) for x, f in document["sliding_friction_by_place"]))
        return _checked(
            bare,
            "signature",
            recorded,
            float(values["spring_n_per_m"]),
            preload_n,
            float(values["sliding_n"]),
            float(values["static_n"]),
            places,
        )
    if identified is not None:
        recorded, document = identified
        found = document["configuration"]["valve"]
        return _checked(
            bare,
            "identify",
            recorded,
            float(found.get("spring_rate_n_per_m", bare.spring_n_per_m)),
            float(found.get("bench_set_n", bare.preload_n)),
            float(found.get("coulomb_friction_n", bare.sliding_n)),
            float(found.get("static_friction_n", bare.static_n)),
            (),
        )
    return bare


def _checked(
    bare: Reference,
    source: str,
    recorded: str,
    spring_n_per_m: float,
    preload_n: float,
    sliding_n: float,
    static_n: float,
    by_place: tuple[tuple[float, float], ...],
) -> Reference:
    """Return the reference, with the stops and the span of `bare`."""
    if not (spring_n_per_m > 0.0 and 0.0 < sliding_n <= static_n and all(friction > 0.0 for _, friction in by_place)):
        raise ValueError(f"spring rate and friction of the kept {source} are not above 0")
    return Reference(
        source,
        recorded,
        spring_n_per_m,
        preload_n,
        sliding_n,
        static_n,
        by_place,
        bare.closed_m,
        bare.open_m,
        bare.span_m,
    )
