"""The report of the robustness test: tables by class and by factor, the worst dwells, and their scenarios. Shell."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from positioner.bench.playable import slidable_mm
from positioner.campaign.report import scenario_text
from positioner.cycle.events import MoveBegan
from positioner.diagnostics.explanation import Explainer
from positioner.diagnostics.explanation_text import command_lines
from positioner.report.table import Table
from positioner.report.text import markdown
from positioner.robustness.cases import BEYOND, CLASSES
from positioner.robustness.judgement import bins, distribution, worst
from positioner.robustness.play import Run, before, recorded, scenario_of, settings_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from positioner.bench.scenario import Scenario
    from positioner.report.text import Block
    from positioner.robustness.judgement import Bin, Distribution, Verdict
    from positioner.robustness.study import Study

WORST = 20
_HEAD = (
    *("class", "law", "dwells", "median, %", "95 %", "99 %", "99.9 %", "worst, %", "overshoot 95, %"),
    *("settling / optimal", "its 95 %", "moves", "travel / ideal", "lost", "lost at most, %", "good while lost"),
    "against the best baseline, %",
)
_BIN_HEAD = (
    *("factor", "from", "to", "dwells", "median, %", "95 %", "99 %", "99.9 %", "worst, %", "overshoot 95, %"),
    *("settling / optimal", "moves", "travel / ideal", "lost", "lost at most, %"),
    *("best baseline", "its median, %", "its 99 %", "its lost", "difference of means, % (95 %)"),
)
_LATE_S, _LATE_MOVES = 5.0, 10.0
_SHORT_PCT = 1.0
"""Of the span: a stem that ends so near to the end of its reach is at it."""


def groups_of(study: Study) -> list[tuple[str, list[Verdict]]]:
    """Return the judged dwells by class, or by the names of a set without the number of the case; then all together."""
    found: dict[str, list[Verdict]] = {}
    for each in study.verdicts:
        case = each.case
        name = case.group if case.group in CLASSES else case.name.partition(" #")[0]
        found.setdefault(name, []).append(each)
    groups = [(name, judged) for name, judged in found.items() if name != BEYOND]
    every = [each for _, judged in groups for each in judged]
    return [*groups, ("all", every)] if len(groups) > 1 else groups


def distributions(study: Study) -> list[tuple[str, Distribution]]:
    """Return the figures of every law in every group."""
    found = []
    for name, judged in groups_of(study):
        for law in study.laws:
            baselines = study.baselines if law == study.judged else ()
            failed = sum(who == law for _, who, _ in study.failures)
            found.append((name, distribution(law, judged, baselines, failed)))
    return found


def blocks(study: Study, title: str) -> list[Block]:
    """Return the report as lines and tables."""
    rows = distributions(study)
    lines: list[Block] = [
        f"# {title}",
        "",
        "Errors are mean |error| over the end of a dwell, in percent of span. Lost: reachable, and more than 1 % off",
        "or hunting. Settling is over the time-optimal move's. The last column is the mean error less that of the best",
        "baseline in this class, with its 95 % interval over valves; **bold**: worse beyond chance.",
        "",
        Table.of(_HEAD, (_row(name, each) for name, each in rows), names=2),
        "",
    ]
    if failed := len(study.failures):
        label, law, why = study.failures[0]
        lines += [f"{failed} runs ended before their time, such as {law} in {label}: {why}", ""]
    if beyond := _beyond_lines(study):
        lines += [*beyond, ""]
    return lines


def factor_blocks(study: Study, found: Sequence[Bin]) -> list[Block]:
    """Return the table of the factors."""
    where = [each.factor for each in found if each.law.is_worse]
    text = f"`{study.judged}` is worse than the best baseline, beyond chance, in {len(where)} of {len(found)} bins"
    named = f": {', '.join(dict.fromkeys(where))}." if where else "."
    return [Table.of(_BIN_HEAD, map(_bin_row, found)), "", text + named, ""]


def factor_bins(study: Study) -> list[Bin]:
    """Return what each factor does, over all classes but the setpoints beyond reach."""
    judged = [each for each in study.verdicts if each.case.group in CLASSES and each.case.group != BEYOND]
    return bins(study.judged, study.baselines, judged) if judged else []


def worst_blocks(study: Study, folder: Path) -> list[Block]:
    """Write the scenarios of the worst dwells into `folder`; return them with the commands that replay them."""
    found = worst(study.judged, [each for each in study.verdicts if each.case.group != BEYOND], WORST)
    if not found:
        return [f"`{study.judged}` lost no dwell.", ""]
    place = folder / "worst"
    place.mkdir(parents=True, exist_ok=True)
    for old in place.glob("*.toml"):
        old.unlink()
    lines: list[Block] = ["The worst lost dwells; each command plays the valve again, on a bus:", ""]
    for rank, each in enumerate(found, 1):
        run, dwell = Run(each.case, study.judged), each.by_law[study.judged]
        scenario = replace(scenario_of(run), name=f"worst-{rank}")
        factors = ", ".join(f"{name} {value:g}" for name, value in each.case.factors.items())
        said = "GOOD" if dwell.good else "told"
        where = f"{each.case.label}, dwell {each.number + 1}, to {dwell.setpoint_mm:.2f} mm"
        what = f"**{dwell.error_pct:.2f} %** off{', hunts' if dwell.hunts else ''}, {dwell.moves} moves, {said}"
        lines.append(f"{rank}. {where}: {what}{f' ({factors})' if factors else ''}")
        lines += [f"   `{command}`" for command in _commands(run, scenario, place / f"{rank:02}.toml")]
        lines += [f"   - {line}" for line in _explained(run, scenario, each)]
    return [*lines, ""]


def _commands(run: Run, scenario: Scenario, path: Path) -> Iterator[str]:
    """Write the scenario to `path`; yield the commands that play it, where it is restarted after what came before."""
    state: tuple[str, ...] = ()
    if run.case.restart:
        first = path.with_name(f"{path.stem}-before.toml")
        first.write_text(scenario_text(before(scenario)), encoding="utf-8")
        yield _bench(first)
        state = ("--state", str(first.with_suffix("") / "state"))
    path.write_text(scenario_text(scenario), encoding="utf-8")
    yield _bench(path, *state)


def _bench(path: Path, *more: str) -> str:
    return shlex.join(["positioner", "bench", "--scenario", str(path), "--out", str(path.with_suffix("")), *more])


def _explained(run: Run, scenario: Scenario, verdict: Verdict) -> list[str]:
    """Return what `explain` says of the newest command of the dwell, and of the last move in it."""
    begin_s, end_s = scenario.dwell_edges_s[verdict.number : verdict.number + 2]
    explainer, newest = Explainer(), None
    for cycle in recorded(run, scenario).cycles:
        if cycle.time_s >= end_s:
            break
        reason = cycle.decision.reason
        events = (MoveBegan(reason), cycle) if reason is not None else (cycle,)
        newest = explainer.add(cycle.time_s, cycle.mode, events, cycle.current_ma)
    if newest is None:
        return ["the law was never asked"]
    words = command_lines(newest)
    begun = sum(begin_s <= each.begun_s for each in explainer.moves)
    return [" ".join(each.split()) for each in words] + ([] if begun else ["no move began in this dwell"])


def _row(name: str, each: Distribution) -> tuple[str, ...]:
    lost = each.lost
    cells = (
        *(name, f"`{each.law}`", str(each.dwells), *(f"{one:.3f}" for one in each.quantiles_pct)),
        *(f"{each.worst_pct:.2f}", f"{each.overshoot_95_pct:.2f}", _ratio(each.settle_ratio)),
        *(_ratio(each.settle_ratio_95), f"{each.moves:.1f}", f"{each.travel_ratio:.2f}", str(lost.count)),
        *(f"{100.0 * lost.limits[1]:.2f}", str(each.good_while_lost), _difference(each)),
    )
    return tuple(cells)


def _bin_row(each: Bin) -> tuple[str, ...]:
    own, best = each.law, each.best
    cells = [each.factor, f"{each.low:.3g}", f"{each.high:.3g}", str(own.dwells), f"{own.quantiles_pct[0]:.3f}"]
    cells += [f"{quantile:.2f}" for quantile in (*own.quantiles_pct[1:], own.worst_pct, own.overshoot_95_pct)]
    cells += [_ratio(own.settle_ratio), f"{own.moves:.1f}", f"{own.travel_ratio:.2f}", str(own.lost.count)]
    cells.append(f"{100.0 * own.lost.limits[1]:.2f}")
    if best is None:
        return (*cells, "–", "–", "–", "–", "–")
    theirs = (f"`{best.law}`", f"{best.quantiles_pct[0]:.3f}", f"{best.quantiles_pct[2]:.2f}", str(best.lost.count))
    return (*cells, *theirs, _difference(own))


def _ratio(value: float) -> str:
    return "never" if math.isinf(value) else f"{value:.1f}"


def _difference(each: Distribution) -> str:
    if each.difference_pct is None:
        return "–"
    middle, low, high = each.difference_pct
    text = f"{middle:+.3f} ({low:+.3f} to {high:+.3f}), {each.baseline}"
    return f"**{text}**" if each.is_worse else text


def _beyond_lines(study: Study) -> list[Block]:
    """Return what became of setpoints beyond reach: whether the status said so, and how near the stem came."""
    law = study.judged
    judged = [each for each in study.verdicts if each.case.group == BEYOND and is_beyond(each, law)]
    if not judged:
        return []
    late, silent, short = 0, 0, []
    for each in judged:
        dwell = each.by_law[law]
        within_s = max(_LATE_S, _LATE_MOVES * each.optimal_s) if math.isfinite(each.optimal_s) else _LATE_S
        silent += dwell.told_s is None
        late += dwell.told_s is not None and dwell.told_s > within_s
        short.append(short_of_reach_pct(each, law))
    beyond = sum(one > _SHORT_PCT for one in short)
    in_time = len(judged) - late - silent
    return [
        f"Setpoints beyond reach: {len(judged)}; the status said so in time in {in_time}, late in {late}, never in",
        f"{silent}. The stem ended more than 1 % short of its reach in {beyond} (worst {max(short):.2f} %).",
    ]


def is_beyond(verdict: Verdict, law: str) -> bool:
    """Return whether no current lets the stem slide to within 1 % of the setpoint."""
    settings, setpoint_mm = settings_of(verdict.case), verdict.by_law[law].setpoint_mm
    (low_mm, high_mm), near_mm = slidable_mm(settings), 10.0 * _SHORT_PCT * settings.valve.span_m
    return not low_mm - near_mm <= setpoint_mm <= high_mm + near_mm


def short_of_reach_pct(verdict: Verdict, law: str) -> float:
    """Return by how much of the span the stem ended short of where sliding friction lets the last current take it."""
    settings, dwell = settings_of(verdict.case), verdict.by_law[law]
    low_mm, high_mm = slidable_mm(settings)
    short_mm = high_mm - dwell.end_mm if dwell.setpoint_mm > high_mm else dwell.end_mm - low_mm
    return max(short_mm, 0.0) / settings.valve.span_m * 0.1


def document(study: Study, found: Sequence[Bin]) -> dict[str, Any]:
    """Return the figures as one JSON document."""
    return {
        "laws": list(study.laws),
        "classes": [{"class": name, **_figures(each)} for name, each in distributions(study)],
        "bins": [
            {"factor": each.factor, "low": each.low, "high": each.high, "law": _figures(each.law)}
            | {"best": each.best and _figures(each.best)}
            for each in found
        ],
        "failures": [list(each) for each in study.failures],
    }


def _figures(each: Distribution) -> dict[str, Any]:
    """Return the figures with the limits of the lost part; null where there is no number, as of what never settles."""
    figures = asdict(each)
    figures["lost"]["limits"] = each.lost.limits
    return {name: _finite(value) for name, value in figures.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_json(study: Study, found: Sequence[Bin]) -> str:
    """Return the text of that document."""
    return json.dumps(document(study, found), indent=2, ensure_ascii=False) + "\n"


def write(folder: Path, study: Study, found: Sequence[Bin], lines: Sequence[Block]) -> None:
    """Write `report.md` and `report.json` into `folder`."""
    (folder / "report.md").write_text(markdown(lines), encoding="utf-8")
    (folder / "report.json").write_text(as_json(study, found), encoding="utf-8")
