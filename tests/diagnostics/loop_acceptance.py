"""How well `positioner diagnose` finds sticking valves on emulated loops: `make diagnostics-test`.

With the stem position (noise 0.05 % of span): S ± 5 %, J ± 0.5 points, at least 45 of 60 valves with S from 0.8 to 23 %
found, at most 1 of 56 others accused. From OP and PV: nobody accused in healthy and tightly tuned loops, at most a
tenth under a sinusoidal disturbance and setpoint steps, at least 80 % found where S is 8 % or more, and none of these
called free of stiction. Of healthy loops whose OP moves by more than 1.4 %, at least nine of ten get a no, and none of
those whose OP moves less.
"""

from __future__ import annotations

import argparse
import multiprocessing
import statistics
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from emulated_loops import Kind, Loop, other_loops, play, sticking_loops
from tqdm import tqdm

from positioner.bench.inprocess import configure, run_in_process
from positioner.bench.scenario import load_scenario
from positioner.diagnostics.direct.diagnosis import Record, diagnose_stem
from positioner.diagnostics.finding import finding_of
from positioner.diagnostics.indirect.diagnosis import diagnose_loop
from positioner.diagnostics.indirect.loop import Loop as Recorded
from positioner.diagnostics.indirect.loop import range_of
from positioner.diagnostics.verdict import LEAST_RANGE_PERCENT, Estimate, Verdict
from positioner.replay.stem_log import CURRENT_AT_0_MA, CURRENT_AT_100_MA, stem_table

OTHERS = (Kind.HEALTHY, Kind.TIGHT, Kind.SINE, Kind.STEPS)
LARGE = 8.0
VERDICTS = (Verdict.YES, Verdict.NO, Verdict.UNDECIDED)


@dataclass(frozen=True)
class Outcome:
    loop: Loop
    direct: Verdict
    stick: Estimate | None
    jump: Estimate | None
    indirect: Verdict
    apparent: Estimate | None
    methods: dict[str, Verdict]
    moved: float


def run(loop: Loop) -> Outcome:
    played = play(loop)
    direct = diagnose_stem(Record(played.op, played.stem, 1.0))
    indirect = diagnose_loop(Recorded(played.op, played.pv, played.sp, 1.0))
    told = direct.friction if direct.verdict is Verdict.YES else None
    return Outcome(
        loop,
        direct.verdict,
        told.stick if told else None,
        told.jump if told else None,
        indirect.verdict,
        indirect.stick,
        {each.name: each.verdict for each in indirect.answers},
        range_of(played.op),
    )


def group_of(loop: Loop) -> str:
    if loop.kind is not Kind.STICKING:
        return str(loop.kind)
    return f"sticking, S ≥ {LARGE:g} %" if loop.stick_percent >= LARGE else f"sticking, S < {LARGE:g} %"


def counts(verdicts: list[Verdict]) -> str:
    return " / ".join(str(verdicts.count(each)) for each in VERDICTS)


def table(outcomes: list[Outcome]) -> None:
    names = list(outcomes[0].methods)
    tqdm.write(f"| loops | n | stem position | OP and PV | {' | '.join(names)} |", file=sys.stdout)
    tqdm.write("|---" * (4 + len(names)) + "|", file=sys.stdout)
    for group in dict.fromkeys(group_of(each.loop) for each in outcomes):
        chosen = [each for each in outcomes if group_of(each.loop) == group]
        cells = [counts([each.methods[name] for each in chosen]) for name in names]
        both = [counts([each.direct for each in chosen]), counts([each.indirect for each in chosen])]
        tqdm.write(f"| {group} | {len(chosen)} | {' | '.join([*both, *cells])} |", file=sys.stdout)


def judged(outcomes: list[Outcome]) -> list[tuple[str, bool]]:
    """Return each goal with its figure, and whether it is reached."""
    sticking = [each for each in outcomes if each.loop.kind is Kind.STICKING]
    others = [each for each in outcomes if each.loop.kind is not Kind.STICKING]
    found = [each for each in sticking if each.stick and each.jump]
    sizes = [each.stick.value / each.loop.stick_percent - 1.0 for each in found if each.stick]
    jumps = [each.jump.value - each.loop.jump_percent for each in found if each.jump]
    inside = Counter(
        name
        for each in found
        for name, value, truth in (("S", each.stick, each.loop.stick_percent), ("J", each.jump, each.loop.jump_percent))
        if value and value.low <= truth <= value.high
    )
    near = sum(abs(each) <= 0.05 for each in sizes)
    accused = sum(each.direct is Verdict.YES for each in others)
    large = [each for each in sticking if each.loop.stick_percent >= LARGE]
    told = [each for each in large if each.apparent]
    apparent = [each.apparent.value / each.loop.stick_percent - 1.0 for each in told if each.apparent]
    held = sum(each.apparent.low <= each.loop.stick_percent <= each.apparent.high for each in told if each.apparent)
    yes = Counter(each.loop.kind for each in others if each.indirect is Verdict.YES)
    of = Counter(each.loop.kind for each in others)
    told_no = (Kind.HEALTHY, Kind.STEPS)
    calm, driven = (Kind.HEALTHY, Kind.TIGHT), (Kind.SINE, Kind.STEPS)
    said_yes = sum(each.indirect is Verdict.YES for each in large)
    said_no = sum(each.indirect is Verdict.NO for each in large)
    goals = [
        (f"stem: {len(found)} of {len(sticking)} found", len(found) >= 0.75 * len(sticking)),
        (f"stem: {accused} of {len(others)} others accused", accused <= len(others) / 56.0),
        (f"stem: S {_spread(sizes, 100.0, ' %')}, {near} within 5 %", near >= 0.95 * len(found)),
        (f"stem: J {_spread(jumps, 1.0, ' points')}, goal ± 0.5", all(abs(each) <= 0.5 for each in jumps)),
        (f"stem: S in its interval {inside['S']}, J {inside['J']} of {len(found)}", inside["S"] >= 0.9 * len(found)),
        (f"OP and PV: {said_yes} of {len(large)} with S ≥ 8 % found", said_yes >= 0.8 * len(large)),
        (f"OP and PV: {said_no} of them called free of stiction", said_no == 0),
        (
            f"OP and PV: S {_spread(apparent, 100.0, ' %')}, in its interval {held} of {len(told)}",
            held >= 0.9 * len(told),
        ),
    ]
    excited = [each.indirect for each in others if each.loop.kind in told_no and each.moved > LEAST_RANGE_PERCENT]
    quiet = [each.indirect for each in outcomes if each.moved <= LEAST_RANGE_PERCENT]
    free, unknown = excited.count(Verdict.NO), quiet.count(Verdict.NO)
    what = "with an OP that moves"
    goals += [
        (f"OP and PV: {free} of {len(excited)} healthy {what} called free of stiction", free >= 0.9 * len(excited)),
        (f"OP and PV: {unknown} of {len(quiet)} {what} by at most {LEAST_RANGE_PERCENT:g} % called so", unknown == 0),
    ]
    goals += [(f"OP and PV: {yes[kind]} of {of[kind]} {kind} accused", yes[kind] == 0) for kind in calm]
    return goals + [
        (f"OP and PV: {yes[kind]} of {of[kind]} {kind} accused", yes[kind] <= 0.1 * of[kind]) for kind in driven
    ]


def _spread(values: list[float], scale: float, unit: str) -> str:
    if not values:
        return "-"
    low, middle, high = min(values), statistics.median(values), max(values)
    return f"{scale * low:+.2f} to {scale * high:+.2f}{unit}, median {scale * middle:+.2f}"


def own_log(law: str) -> str:
    """Return what the log of a bench at 1 kHz says: the paper's valve, whose S is 58.65 % and whose J is 5.33 %."""
    noise = {"noise_of_reading": 0.0, "noise_of_span": 0.0005}
    scenario = load_scenario("paper-valve")
    plant, estimator = {**scenario.plant, "sensor": noise}, {**scenario.estimator, **noise}
    scenario = replace(scenario, law=law, plant=plant, estimator=estimator, visits=1, dwell_s=8.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bus.log"
        run_in_process(scenario).recording.write_log(path)
        table = stem_table(path, configure(scenario))
    found = finding_of("log", table, CURRENT_AT_0_MA, CURRENT_AT_100_MA)
    size = f", S {found.stick.value:.2f} ± {found.stick.half_width:.2f} %" if found.stick else ""
    jump = f", J {found.jump.value:.2f} ± {found.jump.half_width:.2f} %" if found.jump else ""
    return f"log of the bus at 1 kHz under {law}: {found.verdict}{size}{jump}: {found.reason}"


def write_example(path: Path) -> None:
    played = play(Loop(Kind.STICKING, 9.0, 3.0, 12))
    table = np.column_stack([np.arange(played.op.size), played.sp, played.pv, played.op, played.stem])
    np.savetxt(path, table, delimiter=",", header="time,SP,PV,OP,stem", comments="", fmt="%.4f")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sticking", type=int, default=60, help="loops with a sticking valve (default: %(default)s)")
    parser.add_argument("--others", type=int, default=14, help="of each other kind (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=40000, help="of the first loop (default: %(default)s)")
    parser.add_argument("--short", action="store_true", help="a few loops only")
    parser.add_argument("--workers", type=int, default=multiprocessing.cpu_count())
    parser.add_argument("--example", type=Path, metavar="FILE", help="only write one loop as CSV: S 9 %%, J 3 %%")
    arguments = parser.parse_args()
    if arguments.example:
        write_example(arguments.example)
        return 0
    if arguments.short:
        arguments.sticking, arguments.others = 8, 2
    loops = sticking_loops(arguments.sticking, 0.8, 23.0, arguments.seed)
    for number, kind in enumerate(OTHERS, 1):
        loops += other_loops(kind, arguments.others, arguments.seed + 1000 * number)
    with multiprocessing.Pool(arguments.workers) as pool:
        outcomes = list(tqdm(pool.imap(run, loops), total=len(loops), unit=" loops", disable=None))
    table(outcomes)
    goals = judged(outcomes)
    tqdm.write("", file=sys.stdout)
    for law in ("pi", "nmpc"):
        tqdm.write(f"- {own_log(law)}", file=sys.stdout)
    tqdm.write("\n| goal and figure | met |\n|---|---|", file=sys.stdout)
    for text, reached in goals:
        tqdm.write(f"| {text} | {'yes' if reached else '**no**'} |", file=sys.stdout)
    return 0 if all(reached for _, reached in goals) else 1


if __name__ == "__main__":
    sys.exit(main())
