"""What later friction is compared with: the valve as `identify` or `signature` measured it, with its date. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from positioner.values import dataclass

if TYPE_CHECKING:
    from collections.abc import Mapping

    from positioner.valve.parameters import ValveParameters

_SAME_OF_SPAN = 0.01
"""Of the span: stops that are no farther apart are the same."""
CONFIGURED = "configuration"
"""The source of a reference that nobody measured."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Spring rate K, its force F_0 at position 0, F_c and F_s in SI units.

    source: the kind of test procedure, or `CONFIGURED`; recorded: its instant (ISO 8601, UTC), empty without one.
    by_place: places in m, rising, and F_c there; empty where it was not measured by place.
    closed_m, open_m: the stops. span_m: 100 % of travel.
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
        values, static_n = document["quantities"], document["quantities"]["static_n"]
        sliding_n = float(values["sliding_n"])
        places = tuple(sorted((float(x), float(f)) for x, f in document["sliding_friction_by_place"]))
        return _checked(
            bare,
            "signature",
            recorded,
            float(values["spring_n_per_m"]),
            kept_preload_n(document),
            sliding_n,
            max(bare.static_n, sliding_n) if static_n is None else float(static_n),
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


def other_travel(valve: ValveParameters, document: Mapping[str, Any]) -> str:
    """Return in words how the travel in a kept result differs from the configured one; empty where it does not.

    A signature without its travel, as earlier versions kept it, must at least have its places within the travel.
    """
    near_m = _SAME_OF_SPAN * valve.span_m
    if (travel_m := document.get("travel_m")) is not None:
        if any(abs(a - b) > near_m for a, b in zip(kept_travel_m(valve), travel_m, strict=True)):
            low, high, span = (1e3 * each for each in travel_m)
            return f"it was measured with a travel from {low:g} to {high:g} mm and a span of {span:g} mm"
        return ""
    for place_m, _ in document.get("sliding_friction_by_place", ()):
        if not valve.travel_min_m - near_m <= place_m <= valve.travel_max_m + near_m:
            return f"it has friction at {1e3 * place_m:.1f} mm, outside the travel"
    return ""


def kept_travel_m(valve: ValveParameters) -> list[float]:
    """Return what a kept result says of the travel that it was measured with: both stops and the span, in m."""
    return [valve.travel_min_m, valve.travel_max_m, valve.span_m]


def kept_preload_n(signature: Mapping[str, Any]) -> float:
    """Return the spring's force at position 0 in N, in the document of a signature.

    Raises:
        KeyError, TypeError, ValueError: it is none.
    """
    found = [float(row["value"]) for row in signature["rows"] if row["name"] == "spring force at 0"]
    if not found:
        raise ValueError("it has no spring force at 0")
    return found[0]


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
