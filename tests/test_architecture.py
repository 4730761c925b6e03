"""Arrows between rooms go one way, lazy and type-only imports included; nothing is listed that is not met."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterable, Mapping
from pathlib import Path

import pytest

from hrclog.diagnostic import CODES

ROOT = Path(__file__).parents[1]
DOTTED = re.compile(r"^(hrclog(?:\.\w+)+):\w+$")
TOP = ("hrclog", "analyzers", "recorders", "sim")

BASICS = """
    _version arrays diagnostic errors event_rows events explanations file_names file_sets files forks frame_files ids
    json_record json_text parallel plugins recipe_names scene state tags units wording
""".split()  # noqa: SIM905 - a list that is read, as those below
"""Modules of hrclog/ that stand on their own or on each other."""

ARROWS: Mapping[str, str] = {
    # room: the rooms it may import, besides the basics
    # log
    "log": "",
    "log.limits": "",
    "log.mcap": "log.limits",
    "log.files": "log.limits log.mcap",
    "log.messages": "log.files log.limits log.mcap",
    "log.bags": "log.files log.limits log.mcap log.messages",
    "log.writing": "log.files log.mcap log.messages",
    "log.remarks": "",
    "log.clocks": "log.remarks",
    "log.annotations": "log.files log.messages log.parts log.remarks log.writing",
    "log.runs": "log.annotations log.remarks",
    "log.losses": "log.mcap log.messages log.remarks log.writing",
    "log.parts": "log.bags log.files log.limits log.losses log.mcap log.messages log.writing",
    "log.never_set": "log.remarks",
    "log.checks": "log.clocks log.never_set log.remarks",
    "log.logs": "log.annotations log.messages",
    "log.selected": "log.annotations log.logs log.runs",
    "log.one_log": ("log.annotations log.bags log.files log.logs log.messages log.parts log.runs log.writing"),
    "log.reader": (
        "log.annotations log.bags log.checks log.clocks log.files log.logs log.losses log.messages log.never_set "
        "log.one_log log.runs log.selected"
    ),
    "log.topics": "log.bags log.files log.mcap log.messages log.parts",
    "log.recover": "log.files log.limits log.losses log.mcap log.messages log.one_log log.remarks log.writing",
    "log.begun": "log.losses log.mcap log.messages log.recover",
    "log.follow": "log.mcap log.messages",
    "log.watch": "log.files log.writing",
    # hrclog
    "planning": "",
    "knowledge": "log",
    # recorders
    "recorders.clock": "",
    "recorders.task_handle": "log",
    "recorders.segments": "log",
    "recorders.turns": "",
    "recorders.event_recorder": "log recorders.segments recorders.task_handle recorders.turns",
    "recorders.recorder": "log recorders.event_recorder recorders.segments recorders.task_handle",
    "recorders.line_fields": "log",
    "recorders.line_times": "log",
    "recorders.run_label": "log",
    "recorders.sample_lines": "log recorders.line_fields recorders.recorder",
    "recorders.json_lines": "log recorders.line_fields recorders.sample_lines recorders.task_handle",
    "recorders.line_run": "recorders.json_lines recorders.recorder recorders.sample_lines",
    "recorders.stdin": (
        "log recorders.json_lines recorders.line_run recorders.line_times recorders.recorder recorders.run_label "
        "recorders.sample_lines recorders.segments"
    ),
    "recorders.annotate": "log",
    "recorders.executors": "log recorders.clock",
    "recorders.dispatch": "planning recorders.clock recorders.event_recorder recorders.recorder recorders.executors",
    "recorders.mapping": "log",
    "recorders.importers": "log recorders.mapping",
    # analyzers
    "analyzers.projections": "log",
    "analyzers.synergy": "analyzers.projections",
    "analyzers.learning": "log knowledge analyzers.projections analyzers.synergy",
    "analyzers.search": "planning knowledge",
    "analyzers.prediction": "log analyzers.projections analyzers.synergy analyzers.learning analyzers.search",
    "analyzers.notebook": "analyzers.projections analyzers.figures",
    "analyzers.result": "log analyzers.projections analyzers.synergy analyzers.figures analyzers.notebook",
    "analyzers.analysis": "log analyzers.projections analyzers.synergy analyzers.result",
    "analyzers.output": "analyzers.exporters analyzers.result",
    "analyzers.comparison": "analyzers.projections analyzers.synergy analyzers.result",
    "analyzers.figures": "log analyzers.projections analyzers.synergy",
    "analyzers.drawing": "analyzers.figures",
    "analyzers.rerun": "analyzers.figures analyzers.drawing analyzers.output",
    "analyzers.report": (
        "knowledge analyzers.projections analyzers.synergy analyzers.figures analyzers.drawing analyzers.result "
        "analyzers.output"
    ),
    "analyzers.live": (
        "log analyzers.projections analyzers.figures analyzers.drawing analyzers.rerun analyzers.result "
        "analyzers.analysis"
    ),
    "analyzers.exporters": "",
    # sim
    "sim.lognormal": "",
    "sim.stream": "",
    "sim.scenarios": "",
    "sim.cell": "sim.lognormal",
    "sim.models": "sim.cell",
    "sim.scenario": "planning sim.cell sim.lognormal",
    "sim.truth": "log sim.scenario",
    "sim.event_queue": "recorders.clock",
    "sim.discrete": "log recorders.clock recorders.executors sim.scenario sim.stream sim.truth",
    "sim.bullet": ("log recorders.clock recorders.executors sim.cell sim.models sim.scenario sim.stream sim.truth"),
    "sim.engine": "log recorders.clock recorders.executors sim.discrete sim.bullet sim.scenario sim.truth",
    "sim.run": (
        "log planning recorders.clock recorders.executors recorders.dispatch sim.engine sim.event_queue sim.scenario "
        "sim.stream sim.truth"
    ),
    "sim.campaign_folder": "log sim.run sim.scenario sim.truth",
    "sim.campaign": "sim.bullet sim.campaign_folder sim.engine sim.event_queue sim.run sim.scenario sim.truth",
}
"""One entry a room: a folder of modules, or a module beside such folders. A name stands for all within its room too."""

LAZY: Mapping[tuple[str, str], str] = {
    ("analyzers.result", "analyzers.report.save"): "`Analysis.to_report` is public, and the report draws an Analysis",
    ("analyzers.result", "analyzers.rerun.save"): "`Analysis.to_rerun` is public, and selection reads an Analysis",
}
"""Arrows that run back, (importer, imported), and why. They are made where they are called, not when a module loads."""

FREE = ("hrclog", "__main__", "cli")
"""The public face with its lazy names, and the command line: they may reach every room."""


def modules() -> dict[str, Path]:
    """Return the file of each module, by its name without the leading `hrclog.`."""
    found: dict[str, Path] = {}
    for top in TOP:
        for path in sorted((ROOT / top).rglob("*.py")):
            relative = path.relative_to(ROOT)
            if path.resolve() != ROOT.resolve() / relative:  # reached through a link
                continue
            parts = relative.with_suffix("").parts[top == "hrclog" :]
            name = ".".join(parts).removesuffix("__init__").rstrip(".")
            found[name or "hrclog"] = path
    return found


MODULES = modules()


def imported(path: Path) -> set[str]:
    """Return the modules that a module imports, anywhere in it and for whatever purpose."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            taken = {name for name in inner if name.removeprefix("hrclog.") in MODULES}
            found.update(taken or {node.module})
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and (path_of := DOTTED.fullmatch(node.value))
        ):
            found.add(path_of[1])  # what a table names is imported when it is asked for
    names = {"hrclog" if name == "hrclog" else name.removeprefix("hrclog.") for name in found if name[:6] == "hrclog"}
    return names & set(MODULES)


IMPORTS = {name: imported(path) - {name} for name, path in MODULES.items()}


def room_of(module: str) -> str:
    """Return the room of a module: its entry in `ARROWS`, or its own name."""
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        if (name := ".".join(parts[:length])) in ARROWS:
            return name
    return module


def rooms_around(module: str) -> set[str]:
    """Return the room of a module, and those that it lies in."""
    parts = room_of(module).split(".")
    return {".".join(parts[:length]) for length in range(1, len(parts) + 1)}


def circles(arrows: Mapping[str, Iterable[str]]) -> list[str]:
    """Return the nodes that can be left and reached again, after those that cannot were taken away."""
    left = {node: set(targets) & set(arrows) for node, targets in arrows.items()}
    while ends := [node for node, targets in left.items() if not targets & set(left)]:
        for node in ends:
            del left[node]
    return sorted(left)


def without_lazy(imports: Mapping[str, set[str]]) -> dict[str, set[str]]:
    return {name: {target for target in targets if (name, target) not in LAZY} for name, targets in imports.items()}


@pytest.mark.parametrize("module", sorted(set(MODULES) - set(TOP)))
def test_a_module_imports_only_rooms_that_its_room_may(module: str) -> None:
    room = room_of(module)
    if room.split(".")[0] in FREE:
        return
    assert room in ARROWS or room in BASICS, f"{module} lies in no room: give it one in ARROWS"
    allowed = {room, *BASICS, *ARROWS.get(room, "").split()}
    targets = without_lazy(IMPORTS)[module]
    if room in BASICS:
        allowed = set(BASICS)
    assert {target for target in targets if not rooms_around(target) & allowed} == set()


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(without_lazy(IMPORTS)) == []


def test_no_rooms_import_each_other_in_a_circle() -> None:
    within = {room: [name for name in ARROWS if name == room or name.startswith(f"{room}.")] for room in ARROWS}
    arrows = {room: [name for target in targets.split() for name in within[target]] for room, targets in ARROWS.items()}
    assert circles(arrows) == []


def test_every_arrow_that_is_listed_is_there() -> None:
    taken = {
        (room_of(name), around)
        for name, targets in IMPORTS.items()
        for target in targets
        for around in rooms_around(target)
    }
    listed = {(room, target) for room, targets in ARROWS.items() for target in targets.split()}
    assert sorted(listed - taken) == []
    assert [pair for pair in LAZY if pair[1] not in IMPORTS[pair[0]]] == []
    assert [room for room in (*ARROWS, *BASICS) if room not in MODULES] == []


def test_arrows_that_run_back_are_imported_where_they_are_called() -> None:
    for importer, target in LAZY:
        tree = ast.parse(MODULES[importer].read_text(encoding="utf-8"))
        at_once = {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
        assert f"hrclog.{target}" not in at_once


@pytest.mark.parametrize("module", sorted(MODULES))
def test_no_function_is_longer_than_sixty_lines_or_takes_more_than_ten_arguments(module: str) -> None:
    public = {("recorders.recorder", "start")}  # its keywords are what users write
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef):
            assert (node.end_lineno or 0) - node.lineno < 60, node.name
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            free = module.startswith("cli.") or node.name == "__init__" or (module, node.name) in public
            assert free or len(arguments) <= 10, node.name


def test_few_modules_lie_loose_in_analyzers() -> None:
    assert len(list((ROOT / "analyzers").glob("*.py"))) <= 5


def test_tests_mirror_the_rooms() -> None:
    rooms = {path.parent.relative_to(ROOT) for path in MODULES.values()}
    mirrored = {Path(*room.parts[room.parts[0] == "hrclog" :]) for room in rooms}
    beside = {Path(name) for name in ("browser", "compat", "corpus", "docs", "helpers", "viewer")}
    folders = {path.parent.relative_to(ROOT / "tests") for path in (ROOT / "tests").rglob("*.py")}
    assert sorted(map(str, folders - mirrored - beside)) == []


def test_every_diagnostic_code_is_used_somewhere() -> None:
    sources = [path.read_text(encoding="utf-8") for name, path in MODULES.items() if name != "diagnostic"]
    assert [code for code in CODES if not any(f'"{code}"' in source for source in sources)] == []
