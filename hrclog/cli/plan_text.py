"""The text about a plan on the terminal: its forecast, why it is good, and its timeline."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

from hrclog.analyzers.search.methods import METHODS
from hrclog.cli.common import printable, table
from hrclog.wording import counted

if TYPE_CHECKING:
    from hrclog.analyzers.search.find import Found
    from hrclog.analyzers.search.forecast import Forecast
    from hrclog.planning.plan import Plan

_WIDTH: Final = 96
_PAIRS: Final = 5
_APART: Final = 0.75  # of the usual time side by side; what is above is not kept apart


def found_text(found: Found) -> str:
    """Return the text about a plan that was found."""
    return "\n".join([*_headline(found), "", *_pair_lines(found), *_doubt_lines(found)])


def _headline(found: Found) -> Iterator[str]:
    prediction = found.forecast
    yield f"{printable(found.plan.name)}: {forecast_line(prediction)}"
    saving = 1 - prediction.mean_s / found.usual_s
    comparison = f"{_percent(saving)} less than" if saving >= 0 else f"{_percent(-saving)} more than"
    yield f"  {comparison} the {found.usual_s:.1f} s of a random plan; {_search_text(found)}"
    yield f"  undisturbed it takes {prediction.undisturbed_s:.1f} s; {_bound_text(found)}"


def _bound_text(found: Found) -> str:
    if not found.bound_s:
        return "of what other plans take at least, nothing is known"
    below = max(1 - found.bound_s / found.forecast.undisturbed_s, 0.0)
    return f"no plan undisturbed takes less than {found.bound_s:.1f} s ({_percent(below)} below it)"


def _percent(part: float) -> str:
    return f"{100 * part:.1f} %"


def forecast_line(told: Forecast) -> str:
    """Return the makespan with its uncertainty."""
    return (
        f"expected {told.mean_s:.1f} s [{told.mean_low_s:.1f}, {told.mean_high_s:.1f}], "
        f"90 % of runs {told.run_low_s:.1f} to {told.run_high_s:.1f} s ({counted(told.worlds, 'run')} drawn)"
    )


def _search_text(found: Found) -> str:
    judged = f"{counted(found.search.judged, 'plan')} judged"
    if METHODS[found.wish.method].by_mean_durations:
        ties = len(found.search.best)
        return f"method {found.wish.method}, one of {ties:,} equally good by it, {judged}"
    if found.search.exhaustive and found.search.judged == 1:
        return f"method {found.wish.method}, the only plan there is"
    if found.search.exhaustive:
        return f"method {found.wish.method}, the best of all {found.search.judged:,} plans"
    reason = found.search.stopped
    stopped = f", stopped {reason}" if reason.startswith("after") else f", {reason}" if reason else ""
    return f"method {found.wish.method}, {judged}{stopped}"


def _pair_lines(found: Found) -> Iterator[str]:
    """Yield the pairs that the plan keeps apart more than chance would, and the time that this saves."""
    rows = [
        (f"{c.task} ({c.agent}) | {c.other_task} ({c.other_agent})", c)
        for c in found.changes
        if round(c.saved_s, 1) > 0 and c.overlap_s < _APART * c.usual_overlap_s
    ][:_PAIRS]
    if rows:
        yield table(
            ("kept apart", "side by side s", "in random plans s", "saves s"),
            [(name, f"{c.overlap_s:.1f}", f"{c.usual_overlap_s:.1f}", f"{c.saved_s:.1f}") for name, c in rows],
        )


def _doubt_lines(found: Found) -> Iterator[str]:
    if found.guessed:
        named = ", ".join(f"{task} by {agent}" for agent, task in found.guessed)
        yield printable(f"guessed, no run shows it succeed yet: {named}")
    if found.unobserved:
        named = ", ".join(f"{first[1]} ({first[0]}) | {second[1]} ({second[0]})" for first, second in found.unobserved)
        yield printable(f"side by side in this plan, and no run tells a factor yet: {named}")


def timeline_text(plan: Plan, ends: Mapping[str, tuple[float, float]] | None = None) -> str:
    """Return the planned times of a plan as bars, a line per agent, and a list of its items.

    Args:
        plan: with planned times.
        ends: 5 % and 95 % quantiles of each item's end, if they are known.
    """
    items = [item for item in plan.items if item.planned_start_s is not None and item.planned_end_s is not None]
    last = max((item.planned_end_s or 0.0 for item in items), default=0.0)
    if not last:
        return f"{printable(plan.name)}: no planned times"
    scale = _WIDTH / last
    letters = _letters(dict.fromkeys(item.task for item in items))
    width = max(len(printable(agent)) for agent in plan.agents())
    lines = []
    for agent in plan.agents():
        row = [" "] * (_WIDTH + 1)
        for item in plan.queue(agent):
            begin, end = round((item.planned_start_s or 0.0) * scale), round((item.planned_end_s or 0.0) * scale)
            row[begin : max(end, begin + 1)] = [letters[item.task]] * max(end - begin, 1)
            row[begin] = "|"
        lines.append(f"{printable(agent).rjust(width)} {''.join(row).rstrip()}|")
    ruler = f"{'0'.rjust(width + 2)}{f'{last:.1f} s'.rjust(_WIDTH)}"
    legend = "  ".join(f"{letter} {printable(task)}" for task, letter in letters.items())
    return "\n".join([*lines, ruler, legend, "", _items(plan, ends)])


def _letters(tasks: Mapping[str, None]) -> dict[str, str]:
    """Return a letter for each task: a free letter of its name, else any free letter."""
    letters: dict[str, str] = {}
    for task in tasks:
        candidates = [char for char in task if char.isalnum()] + [chr(code) for code in range(ord("A"), ord("Z") + 1)]
        letters[task] = next((char for char in candidates if char not in letters.values()), "#")
    return letters


def _items(plan: Plan, ends: Mapping[str, tuple[float, float]] | None) -> str:
    header = ("item", "agent", "task", "start s", "end s", *(("90 % of ends s",) if ends else ()))
    rows = []
    for item in sorted(plan.items, key=lambda item: (item.planned_start_s or 0.0, item.item_id)):
        start, end = (f"{t:.1f}" if t is not None else "n/a" for t in (item.planned_start_s, item.planned_end_s))
        rows.append((item.item_id, item.agent, item.task, start, end, *([_spread(item.item_id, ends)] if ends else [])))
    return table(header, rows, numeric=lambda column: column > 2)


def _spread(item_id: str, ends: Mapping[str, tuple[float, float]]) -> str:
    return f"{ends[item_id][0]:.1f} to {ends[item_id][1]:.1f}" if item_id in ends else "over"
