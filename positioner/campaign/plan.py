"""A campaign as it is played: the scenario that every run changes, the parameters, and the runs in order. Pure."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

from positioner.bench.scenario import Scenario
from positioner.campaign import design
from positioner.campaign.keys import changed
from positioner.campaign.run import Run, digest_of, played_part

if TYPE_CHECKING:
    from collections.abc import Iterator

    from positioner.campaign.design import Parameter
    from positioner.campaign.schema import CampaignFile, Value


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """A campaign without mistakes.

    file, text, source: the settings, the text that they were read from, and its name.
    base: the scenario that every run changes.
    """

    file: CampaignFile
    text: str
    source: str
    base: Scenario
    parameters: tuple[Parameter, ...]

    @property
    def laws(self) -> tuple[str, ...]:
        """The laws, each once."""
        return tuple(dict.fromkeys(self.file.laws))

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the noise, each once."""
        return tuple(dict.fromkeys(self.file.seeds))

    @property
    def digest(self) -> str:
        """A digest of all that decides which runs there are."""
        return digest_of(
            {
                "base": played_part(self.base),
                "parameters": [asdict(each) for each in self.parameters],
                "design": asdict(self.file.design),
                "laws": self.laws,
                "seeds": self.seeds,
            }
        )

    def points(self) -> list[tuple[Value, ...]]:
        """Return the values of the parameters at every point."""
        return design.points(self.file.design, self.parameters)

    def runs(self) -> Iterator[Run]:
        """Yield every run in the order of points, laws and seeds."""
        for number, values in enumerate(self.points()):
            scenario = scenario_at(self.base, self.parameters, values)
            for law in self.laws:
                for seed in self.seeds:
                    yield Run(number, values, replace(scenario, law=law, seed=seed))


def scenario_at(base: Scenario, parameters: tuple[Parameter, ...], values: tuple[Value, ...]) -> Scenario:
    """Return the scenario `base` with these values of the parameters."""
    tables = asdict(base)
    for parameter, value in zip(parameters, values, strict=True):
        for key, own in parameter.keys:
            tables = changed(tables, key, value if own is None else float(value) * own)
    return Scenario(**tables)
