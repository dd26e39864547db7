"""The noise of the position sensor on a command line: KIND:SIZE[,of=reading][,time=S]. Pure.

gaussian:0.05%                    white, σ = 0.05 % of span
uniform:0.05%                     white, evenly spread, with the same σ
correlated:0.05%,time=0.1         first-order autoregressive, with a time constant of 0.1 s
held:2%,of=reading,time=0.01      each value of the Gaussian noise lasts for 10 ms; σ = 2 % of the reading
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from positioner.errors import UsageError
from positioner.inputs.nearest import nearest
from positioner.inputs.toml_reader import laid_over

if TYPE_CHECKING:
    from positioner.bench.scenario import Scenario

_TIMED = {"correlated": "noise_correlation_s", "held": "noise_hold_s"}
_KINDS = ("gaussian", "uniform", *_TIMED)
_EXAMPLE = "write it like gaussian:0.05% or held:2%,of=reading,time=0.01"


def with_noise(scenario: Scenario, given: str) -> Scenario:
    """Return the scenario with this noise; the positioner is told its σ, as the datasheet of a sensor gives it.

    Raises:
        UsageError: it is written in another way than those above.
    """
    sensor = sensor_table(given)
    told = {key: sensor[key] for key in ("noise_of_span", "noise_of_reading")}
    plant = laid_over(scenario.plant, {"sensor": sensor})
    return replace(scenario, plant=plant, estimator={**scenario.estimator, **told})


def sensor_table(given: str) -> dict[str, Any]:
    """Return the `[sensor]` table of a plant with this noise.

    Raises:
        UsageError: as `with_noise`.
    """
    kind, _, rest = given.partition(":")
    if kind not in _KINDS:
        raise UsageError(f"--noise {given}: {kind!r} is unknown; {nearest(kind, _KINDS)}; {_EXAMPLE}")
    size, *pairs = (part.strip() for part in rest.split(","))
    keys = dict(pair.partition("=")[::2] for pair in pairs)
    known = ("of", "time") if kind in _TIMED else ("of",)
    for key in keys:
        if key not in known:
            raise UsageError(f"--noise {given}: {key!r} is unknown; {nearest(key, known)}; {_EXAMPLE}")
    if (of := keys.get("of", "span")) not in {"span", "reading"}:
        raise UsageError(f"--noise {given}: of={of}: it is of the span or of the reading")
    fraction = _number(size.removesuffix("%"), given) / 100.0
    table: dict[str, Any] = {
        "noise_of_span": fraction if of == "span" else 0.0,
        "noise_of_reading": fraction if of == "reading" else 0.0,
        "noise_shape": "uniform" if kind == "uniform" else "gaussian",
        "noise_hold_s": 0.0,
        "noise_correlation_s": 0.0,
    }
    if kind in _TIMED:
        if "time" not in keys:
            raise UsageError(f"--noise {given}: needs time=…, in s; {_EXAMPLE}")
        table[_TIMED[kind]] = _number(keys["time"].removesuffix("s"), given)
        if not table[_TIMED[kind]]:
            raise UsageError(f"--noise {given}: time must be above 0 s; without one the noise is white: gaussian")
    return table


def _number(text: str, given: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= 0.0):
        raise UsageError(f"--noise {given}: {text!r} is no number of 0 or more; {_EXAMPLE}")
    return value
