"""The files of a campaign: `summary.json`, `summary.md`, the scenarios of the worst corners, the pictures. Shell."""

from __future__ import annotations

import json
import shlex
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import tomli_w

from positioner.campaign.check import shown
from positioner.campaign.pictures import draw_corners, draw_sensitivity
from positioner.campaign.summary import by_chance
from positioner.report.table import Table
from positioner.report.text import markdown
from positioner.studies.bouts import file_name

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from positioner.bench.scenario import Scenario
    from positioner.campaign.plan import Campaign
    from positioner.campaign.run import PlayedRun
    from positioner.campaign.summary import LawSummary, Mean, Summary
    from positioner.report.text import Block

_CORNERS = "corners"
_MOST_BY_CHANCE = 0.25
"""What chance may explain of the variance before the points are called few."""
_ENOUGH_POINTS = 32
"""The fewest of a Sobol sequence that leave less than that to chance: 19 %, and 16 leave 34 % (`by_chance`)."""
_ENOUGH_SEEDS = 4
"""A bootstrap of n values is n times the smallest with 1/nⁿ: above 2.5 %, and so the interval's end, up to n = 3."""


@dataclass(frozen=True, slots=True)
class Corner:
    """One of the worst runs, and the command that replays it."""

    played: PlayedRun
    command: str


def write_report(folder: Path, campaign: Campaign, played: Sequence[PlayedRun], summary: Summary) -> list[Block]:
    """Write the files into `folder`, and return the summary."""
    corners = _write_corners(folder, summary)
    found = blocks(campaign, summary, corners)
    (folder / "summary.md").write_text(markdown(found), encoding="utf-8")
    (folder / "summary.json").write_text(_to_json(campaign, summary, corners), encoding="utf-8")
    draw_sensitivity(folder / "sensitivity.png", campaign, played, summary)
    draw_corners(folder / "corners.png", campaign, played, [(each.played, each.command) for each in corners])
    return found


def scenario_text(scenario: Scenario) -> str:
    """Return the file of a scenario."""
    return tomli_w.dumps({key: value for key, value in asdict(scenario).items() if value not in (None, {}, "")})


def _write_corners(folder: Path, summary: Summary) -> list[Corner]:
    place = folder / _CORNERS
    place.mkdir(exist_ok=True)
    for old in place.glob("*.toml"):
        old.unlink()
    corners, numbers = [], dict.fromkeys((each.run.law for each in summary.corners), 0)
    for each in summary.corners:
        run = each.run
        numbers[run.law] += 1
        path = place / f"{file_name(run.law)}-{numbers[run.law]}.toml"
        name = f"{run.scenario.name}-{path.stem}"[:40]
        path.write_text(scenario_text(replace(run.scenario, name=name)), encoding="utf-8")
        command = ["positioner", "bench", "--scenario", str(path), "--law", run.law, "--seed", str(run.seed)]
        corners.append(Corner(each, shlex.join([*command, "--out", str(place / path.stem)])))
    return corners


def _to_json(campaign: Campaign, summary: Summary, corners: Sequence[Corner]) -> str:
    names = [each.name for each in campaign.parameters]
    content: dict[str, Any] = {
        "name": campaign.file.name,
        "title": campaign.file.title,
        "campaign_digest": campaign.digest,
        "laws": [asdict(law) for law in summary.laws],
        "effects": [asdict(effect) for effect in summary.effects],
        "corners": [
            {
                "law": corner.played.run.law,
                "seed": corner.played.run.seed,
                "point": corner.played.run.point,
                "parameters": dict(zip(names, corner.played.run.values, strict=True)),
                **asdict(corner.played.outcome),
                "command": corner.command,
            }
            for corner in corners
        ],
    }
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def blocks(campaign: Campaign, summary: Summary, corners: Sequence[Corner]) -> list[Block]:
    """Return the summary: laws, effects, worst corners."""
    lines: list[Block] = [f"# {campaign.file.name}: {campaign.file.title}", "", _about(campaign, summary), ""]
    head = ("law", "runs", "error, % (95 %)", "worst dwell, %", "settles to 1 %, ms", "unsettled", "limit cycles",
            "travel / ideal", "not in control", "failed")  # fmt: skip
    lines += [Table.of(head, map(_law_cells, summary.laws)), ""]
    laws = [law.law for law in summary.laws]
    lines += [
        "What each parameter explains alone of the variance of the error between the points, and the error at the ends",
        "of its range:",
        "",
        Table.of(("parameter", *laws), _effect_rows(campaign, summary, laws)),
        "",
    ]
    if corners:
        lines += ["The worst corners; each command plays its run again, on a bus, with the same figures:", ""]
        lines += [line for corner in corners for line in _corner_lines(campaign, corner)]
    return lines


def _about(campaign: Campaign, summary: Summary) -> str:
    points, seeds = len(campaign.points()), len(campaign.seeds)
    kind = str(campaign.file.design.kind).replace("-", " ")
    over = "seeds" if kind == "grid" else "points"
    has_interval = any(law.error.low_pct is not None for law in summary.laws)
    interval = f"In parentheses: 95 % percentile bootstrap over the means of the {over}."
    none = f"No intervals: they are over the {over}, and there is only one."
    chance, few = by_chance(campaign), ""
    if chance is not None and chance > _MOST_BY_CHANCE:
        few = (
            f" These are few points: a parameter without any effect may explain {100.0 * chance:.0f} % by chance "
            f"(2 σ), and the intervals are too narrow; give {_ENOUGH_POINTS} or more."
        )
    elif kind == "grid" and 1 < seeds < _ENOUGH_SEEDS:
        few = f" {seeds} seeds are few: an interval ends at the smallest and the largest; give {_ENOUGH_SEEDS} or more."
    return (
        f"{points} points ({kind}, seed {campaign.file.design.seed}) × {len(campaign.laws)} laws × {seeds} seeds. "
        "Errors in percent of span; unsettled and limit cycles in dwells; settling is the median of the runs. "
        f"{interval if has_interval else none}{few}"
    )


def _law_cells(law: LawSummary) -> tuple[str, ...]:
    settle_s = law.median_settle_1pct_s
    return (
        f"`{law.law}`",
        str(law.runs),
        _with_interval(law.error),
        f"{law.worst_dwell_pct:.2f}",
        "never" if settle_s is None else f"{settle_s * 1e3:.1f}",
        str(law.unsettled),
        str(law.limit_cycles),
        "–" if law.travel_ratio is None else f"{law.travel_ratio:.2f}",
        str(law.out_of_control),
        str(law.failed),
    )


def _effect_rows(campaign: Campaign, summary: Summary, laws: Sequence[str]) -> Iterator[tuple[str, ...]]:
    found = {(effect.law, effect.parameter): effect for effect in summary.effects}
    for parameter in campaign.parameters:
        cells = []
        for law in laws:
            effect = found[law, parameter.name]
            share = "–" if effect.explained is None else f"{100.0 * effect.explained:.0f} %"
            cells.append(f"{share}: {_with_interval(effect.parts[0].error)} → {_with_interval(effect.parts[-1].error)}")
        yield (f"`{parameter.name}`", *cells)


def _corner_lines(campaign: Campaign, corner: Corner) -> list[str]:
    run, figures = corner.played.run, corner.played.outcome.figures
    named = zip(campaign.parameters, run.values, strict=True)
    values = ", ".join(f"{parameter.name} = {shown(value)}" for parameter, value in named)
    found = corner.played.outcome.failure or ""
    if figures is not None:
        found = f"worst dwell {figures.worst_mean_abs_error_pct:.2f} %, mean {figures.mean_abs_error_pct:.2f} %"
        found += (
            f", in control {100.0 * figures.active_fraction:.4g} % of the time" if figures.active_fraction < 1.0 else ""
        )
    return [f"- `{run.law}`, point {run.point}, seed {run.seed}: {found} ({values})", f"  `{corner.command}`"]


def _with_interval(error: Mean) -> str:
    if error.low_pct is None or error.high_pct is None:
        return f"{error.mean_pct:.3f}"
    return f"{error.mean_pct:.3f} ({error.low_pct:.3f}–{error.high_pct:.3f})"
