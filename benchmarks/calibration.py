"""Regenerate the calibration tables of docs/simulation.md: simulated durations beside those of the authors' runs.

python benchmarks/calibration.py [--data DIR] [--repeats 4] [--half tuned|shown] [--write]

DIR holds safety_areas/, whose 51 runs name the plans of the first table; without it random plans are used there too.
Parameters are chosen on one half of the plans and the tables show the other; `--half tuned` shows the first.
"""

from __future__ import annotations

import argparse
import re
import statistics
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from hrclog.analyzers.projections.intervals import intervals
from hrclog.events import Event, TaskEnded, TaskStarted
from hrclog.log.reader import read_events
from hrclog.parallel import ordered_map
from hrclog.planning.plan import Plan, make_plan
from hrclog.recorders.importers.mongo import import_mongo
from hrclog.sim.run import plan_of, simulate_run
from hrclog.sim.scenario import Scenario, load_scenario

PAGE = Path(__file__).parents[1] / "docs" / "simulation.md"
AGENTS = {"human_right_arm": "human", "ur5_on_guide": "robot"}
PLANS = 50

Key = tuple[str, str]


@dataclass(frozen=True)
class Target:
    """Durations (mean, standard deviation), makespan (the same) and median gaps of real runs, in s."""

    durations: dict[Key, tuple[float, float]]
    makespan: tuple[float, float]
    gaps: dict[str, float]


TARGETS = {
    "authors-areas": Target(
        {
            ("robot", "pick_blue_box"): (7.33, 4.26),
            ("robot", "pick_orange_box"): (6.85, 2.81),
            ("robot", "place_blue_box"): (6.34, 4.88),
            ("robot", "place_orange_box"): (6.77, 4.40),
            ("human", "pick_blue_box"): (6.59, 1.90),
            ("human", "pick_white_box"): (7.85, 1.33),
            ("human", "place_blue_box"): (4.22, 0.48),
            ("human", "place_white_box"): (4.97, 0.58),
        },
        (101.2, 4.7),
        {"robot": 0.83, "human": 1.23},
    ),
    "authors-ssm": Target(
        {
            ("robot", "pick_blue_box"): (9.79, 6.35),
            ("robot", "pick_orange_box"): (5.30, 0.42),
            ("robot", "place_blue_box"): (3.48, 0.47),
            ("robot", "place_orange_box"): (5.15, 1.63),
            ("human", "pick_blue_box"): (6.29, 1.24),
            ("human", "pick_white_box"): (6.56, 0.47),
            ("human", "place_blue_box"): (3.89, 0.42),
            ("human", "place_white_box"): (5.10, 0.54),
        },
        (73.4, 7.1),
        {"robot": 0.09, "human": 0.51},
    ),
}


@dataclass
class Sample:
    """What simulated runs came to, in s."""

    durations: dict[Key, list[float]] = field(default_factory=lambda: defaultdict(list))
    gaps: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    makespans: list[float] = field(default_factory=list)

    def add(self, events: Sequence[Event]) -> None:
        """Take in a run."""
        started: dict[str, int] = {}
        ended: dict[str, int] = {}
        self.makespans.append((events[-1].time_ns - events[0].time_ns) / 1e9)
        for event in events:
            if isinstance(event, TaskStarted):
                started[event.execution_id] = event.time_ns
                if event.agent in ended:
                    self.gaps[event.agent].append((event.time_ns - ended[event.agent]) / 1e9)
            elif isinstance(event, TaskEnded) and event.execution_id in started:
                ended[event.agent] = event.time_ns
                spent_s = (event.time_ns - started[event.execution_id]) / 1e9
                self.durations[event.agent, event.task].append(spent_s)


def main() -> None:
    """Measure, print, and with --write put the tables into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--repeats", type=int, default=4, help="runs of each plan")
    parser.add_argument("--half", choices=("tuned", "shown"), default="shown")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    for name, target in TARGETS.items():
        scenario = load_scenario(name)
        plans = real_plans(scenario, options.data) if options.data and name == "authors-areas" else []
        halves = halved(plans or [plan_of(scenario, 1, index) for index in range(PLANS)])
        chosen = halves[0] if options.half == "tuned" else halves[1]
        sample = simulate(scenario, chosen, options.repeats, options.workers)
        text = table(sample, target, len(chosen), options.repeats)
        print(f"{name}\n{text}\n")
        if options.write:
            page = PAGE.read_text(encoding="utf-8")
            PAGE.write_text(replaced(page, name, text), encoding="utf-8")


def real_plans(scenario: Scenario, data: Path) -> list[Plan]:
    """Return the plans that the authors' offline runs carried out, one a run."""
    with tempfile.TemporaryDirectory() as folder:
        import_mongo([data / "safety_areas" / "task_results.json"], Path(folder))
        executions = intervals(read_events(sorted(Path(folder).glob("*.mcap"))))
    plans = []
    for (run_id,), run in executions.sort("run_id", "start_ns").group_by("run_id", maintain_order=True):
        orders: dict[str, list[str]] = {agent: [] for agent in AGENTS.values()}
        for agent, task in run.select("agent", "task").iter_rows():
            orders[AGENTS[agent]].append(task.removesuffix(f"_{agent}"))
        plans.append(make_plan(scenario.problem, orders, str(run_id)))
    return plans


def halved(plans: Iterable[Plan]) -> tuple[list[Plan], list[Plan]]:
    """Return two halves that have no plan in common: every other one of the different plans, with its repetitions."""
    halves: tuple[list[Plan], list[Plan]] = ([], [])
    numbers: dict[str, int] = {}
    for plan in plans:
        number = numbers.setdefault(str(plan.orders()), len(numbers))
        halves[number % 2].append(plan)
    return halves


def simulate(scenario: Scenario, plans: Sequence[Plan], repeats: int, workers: int) -> Sample:
    """Return what runs of each plan came to."""
    sample = Sample()
    jobs = [(seed, index, plan) for seed in range(1, repeats + 1) for index, plan in enumerate(plans)]
    for events in ordered_map(partial(run_events, scenario), jobs, workers):
        sample.add(events)
    return sample


def run_events(scenario: Scenario, job: tuple[int, int, Plan]) -> tuple[Event, ...]:
    """Return the events of one run."""
    seed, index, plan = job
    return simulate_run(scenario, seed, index, plan, engine="bullet").events


def table(sample: Sample, target: Target, plans: int, repeats: int) -> str:
    """Return the table in markdown."""
    lines = [
        f"{plans} plans, {repeats} runs of each.",
        "",
        "| agent | task | real (s) | simulated (s) | mean | sd | n |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for (agent, task), (mean, sd) in target.durations.items():
        own = sample.durations[agent, task]
        lines.append(_line(agent, task, (mean, sd), own))
    lines.append(_line("both", "makespan", target.makespan, sample.makespans))
    for agent, gap_s in target.gaps.items():
        own = sample.gaps[agent]
        median = statistics.median(own)
        lines.append(
            f"| {agent} | gap (median) | {gap_s:.2f} | {median:.2f} | {median - gap_s:+.2f} s | | {len(own)} |"
        )
    return "\n".join(lines)


def _line(agent: str, task: str, real: tuple[float, float], own: Sequence[float]) -> str:
    mean, sd = statistics.mean(own), statistics.stdev(own)
    beside = f"{mean / real[0] - 1:+.1%} | x {sd / real[1]:.2f}".replace("%", " %")
    return f"| {agent} | {task} | {real[0]:.2f} ± {real[1]:.2f} | {mean:.2f} ± {sd:.2f} | {beside} | {len(own)} |"


def replaced(page: str, name: str, text: str) -> str:
    """Return a page with other text between the marks of a name."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(page):
        raise SystemExit(f"{PAGE}: no marks {begin} ... {end}")
    return pattern.sub(lambda _: f"{begin}\n{text}\n{end}", page)


if __name__ == "__main__":
    main()
