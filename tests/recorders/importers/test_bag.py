"""Bags of every kind into logs: what they hold, twice, damaged, hostile, and with a mapping that does not fit."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import ros_bags as bags
import zstandard

import hrclog.sample_logs
from hrclog.analyzers.projections.intervals import intervals
from hrclog.cli import main
from hrclog.diagnostic import Diagnostic
from hrclog.errors import HrclogError, ImportDataError, LogReadError, MappingError
from hrclog.log.reader import read_logs
from hrclog.recorders.importers.bag import Bag
from hrclog.recorders.importers.importer import Imported
from hrclog.recorders.importers.writing import import_files

pytestmark = pytest.mark.slow

T = 1_700_000_000_000_000_000
S = 10**9
MAP = '[[action]]\ntopic = "/{agent}/do"\ntask = { field = "goal.task" }\nreason = { field = "result.message" }\n'
GOAL_REASON = 'reason = { field = "result.message" }\n'
Row = tuple[Any, ...]


def executed(action: str, task: str, start: int, end: int, number: int, state: int = 4) -> list[bags.Sent]:
    """Return all that Kilted records of a goal."""
    goal = f"{action} {number}"
    return [
        *bags.send_goal(start - 2000, action, goal, task, number),
        bags.status_array(start - 1000, action, [(goal, start - 1000, 1)]),
        bags.status_array(start, action, [(goal, start - 1000, 2)]),
        bags.feedback((start + end) // 2, action, goal, 0.5),
        bags.status_array(end, action, [(goal, start - 1000, state)]),
        *bags.get_result(end + 1000, action, goal, state, "so", number),
    ]


TWO = [
    *executed("/robot/do", "pick", T, T + 4 * S, 1),
    *executed("/human/do", "screw", T + S, T + 6 * S, 1, 6),
    *executed("/human/do", "screw", T + 7 * S, T + 9 * S, 2),
]
ROWS = [
    ("human", "screw", T + S, T + 6 * S, "failed", 1),
    ("human", "screw", T + 7 * S, T + 9 * S, "succeeded", 2),
    ("robot", "pick", T, T + 4 * S, "succeeded", 1),
]


def do_import(folder: Path, sources: Sequence[Path], mapping: str = MAP, **options: object) -> Imported:
    (folder / "cell.toml").write_text(mapping)
    return import_files(Bag(), sources, folder / "logs", map=folder / "cell.toml", **options)  # type: ignore[arg-type]  # by name


def rows(*logs: Path) -> list[Row]:
    columns = ("agent", "task", "start_ns", "end_ns", "outcome", "attempt")
    return sorted(intervals(read_logs(logs).events).select(columns).rows())


def codes(findings: Sequence[Diagnostic]) -> list[str]:
    """Return the codes of findings, but for that on checksums, which is about the storage."""
    return sorted(finding.code for finding in findings if finding.code != "unprotected")


@pytest.mark.parametrize("storage", ["mcap", "sqlite"])
def test_a_bag_is_a_run_and_importing_it_again_adds_nothing(storage: str, tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path / "monday", TWO, storage)
    imported = do_import(tmp_path, [bag], run_tags={"participant": "P01", "note": "a=b"})
    assert (imported.runs, imported.n_executions, codes(imported.diagnostics)) == (["monday"], 3, [])
    log = tmp_path / "logs" / "monday.mcap"
    assert rows(log) == ROWS
    events = read_logs([log]).events
    assert set(events.filter(kind="task_ended")["reason"]) == {"so"}
    details = json.loads(events.filter(kind="run_started")["details"].item())
    assert (details["source"], details["tags"]) == ("bag", {"participant": "P01", "note": "a=b"})
    before = log.read_bytes()
    again = do_import(tmp_path, [bag], run_tags={"participant": "P01", "note": "a=b"})
    assert (again.written, again.unchanged) == ([], [log])
    assert log.read_bytes() == before
    with pytest.raises(ImportDataError, match="the source has changed"):
        do_import(tmp_path, [bag], run_tags={"participant": "P02"})


def test_ids_come_from_what_the_bag_holds_and_not_from_its_name_or_storage(tmp_path: Path) -> None:
    one, other = bags.write_bag(tmp_path / "one", TWO), bags.write_bag(tmp_path / "other", TWO, "sqlite")
    imported = do_import(tmp_path, [one, other])
    assert imported.runs == ["one"]
    assert codes(imported.diagnostics) == ["duplicate_events"]
    (tmp_path / "x").mkdir()
    assert do_import(tmp_path / "x", [other]).runs == ["other"]
    ids = [read_logs([log]).events["execution_id"].to_list() for log in tmp_path.glob("**/logs/*.mcap")]
    assert ids[0] == ids[1]


def test_parts_and_bags_are_told_apart_by_their_names(tmp_path: Path) -> None:
    day = tmp_path / "day"
    bags.write_mcap(day / "day_0.mcap", executed("/robot/do", "pick", T, T + S, 1))
    bags.write_mcap(day / "day_1.mcap", executed("/human/do", "screw", T, T + S, 1))
    assert do_import(tmp_path, [day]).runs == ["day"]
    single = do_import(tmp_path, [day / "day_1.mcap"])
    assert (single.runs, single.n_executions) == (["day_1"], 1)
    for name in ("a", "b"):
        bags.write_mcap(tmp_path / "two" / f"{name}.mcap", executed("/robot/do", name, T, T + S, 10 * ord(name)))
        bags.write_bag(tmp_path / name / "same", executed("/robot/do", name, T, T + S, ord(name)))
    assert do_import(tmp_path, [tmp_path / "two" / "a.mcap", tmp_path / "two"]).runs == ["a", "b"]
    [first, second] = do_import(tmp_path, [tmp_path / "a", tmp_path / "b"]).runs
    assert first == "same"
    assert second.startswith("same_")


@pytest.mark.parametrize(
    ("sample", "bag"),
    [(f"ros2/{name}", f"ros2/{name}") for name in ("bench_a", "bench_b")]
    + [(f"ros1/{name}.bag", f"ros1/{name}.bag") for name in ("bench_a", "bench_b")]
    + [("ros2/plansys2_humble", "ros2/plansys2_humble")],
)
def test_samples_give_what_is_expected(sample: str, bag: str, data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir.parent / "samples"
    if not folder.is_dir():
        pytest.skip("no shared samples")
    listed = json.loads((folder / "expect.json").read_text())["files"][sample]["executions"]
    words = {"open": "unknown"}
    expected = sorted((row[2], row[3] or "do_task", *row[4:6], words.get(row[6], row[6]), row[7]) for row in listed)
    mapping = '[[action]]\ntopic = "/robot/{task}"\nagent = "robot"\n'
    mapping += '[[action]]\ntopic = "/human/do_task"\nagent = "human"\ntask = { field = "goal.task" }\n'
    imported = do_import(tmp_path, [folder / bag], "[[plansys2]]\n" if "plansys2" in sample else mapping)
    assert rows(*imported.written) == expected


def test_several_bags_and_a_bad_one(tmp_path: Path) -> None:
    good = bags.write_bag(tmp_path / "good", TWO)
    torn, noise = tmp_path / "torn.mcap", tmp_path / "noise.bag"
    other = executed("/robot/do", "pick", T + 99 * S, T + 100 * S, 9)
    whole = bags.write_mcap(tmp_path / "whole.mcap", [*other, bags.text(T + 101 * S, "/x", "y" * 999)], chunk_size=200)
    torn.write_bytes(whole.read_bytes()[:-900])
    noise.write_bytes(b"no bag")
    imported = do_import(tmp_path, [good, torn, noise, tmp_path / "absent"])
    assert imported.runs == ["good", "torn"]
    assert rows(tmp_path / "logs" / "good.mcap") == ROWS
    assert {"truncated", "unreadable_file"} <= set(codes(imported.diagnostics))
    with pytest.raises(LogReadError, match="absent"):
        do_import(tmp_path, [tmp_path / "absent"])


@pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])
def test_what_is_left_of_a_bag_is_imported(kind: str, tmp_path: Path) -> None:
    path = tmp_path / f"half.{kind}"
    many = [
        message for n in range(40) for message in executed("/robot/do", "pick", T + 9 * n * S, T + (9 * n + 4) * S, n)
    ]
    if kind == "mcap":
        bags.write_mcap(path, many, chunk_size=500)
    elif kind == "db3":
        bags.write_sqlite(path, many, "kilted")
    else:
        path = bags.write_ros1(path, ros1_session())
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    imported = do_import(tmp_path, [path])
    assert 0 < imported.n_executions <= 40
    assert any(finding.severity == "error" for finding in imported.diagnostics)


def ros1_session() -> list[bags.Sent]:
    return [
        message
        for n in range(40)
        for message in (
            bags.ros1_goal(T + n * 9 * S, T + n * 9 * S, "/robot/do", f"g{n}", "pick"),
            bags.ros1_status(T + n * 9 * S + 1, T + n * 9 * S + 1, "/robot/do", [(f"g{n}", 1)]),
            bags.ros1_result(T + n * 9 * S + S, T + n * 9 * S + S, "/robot/do", f"g{n}", 3),
        )
    ]


def test_a_mapping_that_does_not_fit_lists_what_there_is(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path / "bag", [*TWO, bags.number(T, "/d", 1.0)])
    with pytest.raises(
        MappingError, match=r"signal\[1\]: found no topic '/dd'.*\n.*there are: /d \(std_msgs/msg/Float64\)"
    ):
        do_import(tmp_path, [bag], MAP + '[[signal]]\ntopic = "/dd"\nname = "d"\n')
    with pytest.raises(
        MappingError, match=r"signal\[1\]: topic /d \(std_msgs/msg/Float64\): found no field 'x'; it has data"
    ):
        do_import(tmp_path, [bag], MAP + '[[signal]]\ntopic = "/d"\nname = "d"\nfield = "x"\n')
    with pytest.raises(MappingError, match=r"found no topic '/\{agent\}/dou' in 1 bag"):
        do_import(tmp_path, [bag], MAP.replace("/do", "/dou"))
    with pytest.raises(MappingError, match=r"no field 'job' of 'goal.job'; it has task"):
        do_import(tmp_path, [bag], MAP.replace("goal.task", "goal.job"))
    optional = MAP + '[[signal]]\ntopic = "/dd"\nname = "d"\noptional = true\n'
    assert do_import(tmp_path, [bag], optional).diagnostics == []
    other = bags.write_bag(tmp_path / "other", [bags.number(T, "/d", 1.0)])
    (tmp_path / "x").mkdir()
    findings = do_import(tmp_path / "x", [bag, other]).diagnostics
    assert codes(findings) == ["no_events"]
    assert "/d (std_msgs/msg/Float64)" in findings[0].message


def test_without_a_mapping_the_way_to_one_is_told(tmp_path: Path) -> None:
    with pytest.raises(HrclogError, match="--suggest"):
        import_files(Bag(), [tmp_path], tmp_path / "logs")


UNNAMED = '[[action]]\ntopic = "/{agent}/do"\ntask = "do"\n'
GOAL = 'definition = "string task"\n'
WHOLE = 'definition = """string task\n---\nbool ok\nstring message\n---\nfloat32 progress\n"""\n'


@pytest.mark.parametrize("storage", ["mcap", "sqlite"])
def test_goals_without_the_definition_of_their_type_are_read_by_that_of_the_mapping(
    storage: str, tmp_path: Path
) -> None:
    bag = bags.write_bag(tmp_path / "bag", TWO, storage, "jazzy" if storage == "mcap" else "none")
    for number, definition in enumerate((WHOLE, GOAL)):
        folder = tmp_path / str(number)
        folder.mkdir()
        mapping = MAP.replace(GOAL_REASON, "") if definition is GOAL else MAP
        imported = do_import(folder, [bag], mapping + definition)
        assert [finding.code for finding in imported.diagnostics if finding.severity != "info"] == []
        assert rows(folder / "logs") == ROWS


def test_goals_that_cannot_be_read_are_told_and_not_called_missing(tmp_path: Path) -> None:
    bag = bags.write_bag(tmp_path / "bag", TWO, "mcap", "jazzy")
    for number, (mapping, code) in enumerate(((UNNAMED, "goals_unread"), (MAP, "goal_not_recorded"))):
        folder = tmp_path / str(number)
        folder.mkdir()
        told = [finding for finding in do_import(folder, [bag], mapping).diagnostics if finding.code == code]
        assert len(told) == 2
        assert all("not the definition of cell/action/DoTask_SendGoal_Event" in finding.message for finding in told)


def test_types_without_a_definition_are_told_once(tmp_path: Path) -> None:
    status = [message for message in TWO if message.kind == bags.STATUS]
    states = [bags.Sent(T, "/joint_states", "strange_msgs/msg/Joints", b"\0\1\0\0")]
    for name in ("one", "two"):
        bags.write_bag(tmp_path / "bags" / name, [*status, *states], "sqlite", "none")
    mapping = '[[action]]\ntopic = "/{agent}/do"\ntask = "work"\n[[joints]]\n'
    imported = do_import(tmp_path, [tmp_path / "bags"], mapping)
    assert codes(imported.diagnostics) == ["duplicate_events", "standard_definition", *["undecodable_event"] * 2]
    assert any("strange_msgs/msg/Joints is not in the recording" in str(finding) for finding in imported.diagnostics)
    assert rows(*imported.written) == [(agent, "work", *rest) for agent, _, *rest in ROWS]


def test_compressed_bags_and_messages_are_unpacked(tmp_path: Path) -> None:
    whole = bags.write_mcap(tmp_path / "a" / "whole.mcap", TWO)
    packed = tmp_path / "packed.mcap.zstd"
    packed.write_bytes(zstandard.ZstdCompressor().compress(whole.read_bytes()))
    each = [
        bags.Sent(sent.time_ns, sent.topic, sent.kind, zstandard.ZstdCompressor().compress(sent.data)) for sent in TWO
    ]
    bags.write_mcap(tmp_path / "each.mcap", each)
    for path in (packed, tmp_path / "each.mcap"):
        assert rows(*do_import(tmp_path, [path]).written) == ROWS


def test_names_of_a_hostile_bag_stay_names(tmp_path: Path) -> None:
    task = '../../etc\n"x" \x1b]0;t\x07 ünï'
    bag = bags.write_mcap(tmp_path / "..a b;c.mcap", executed("/robot/do", task, T, T + S, 1))
    imported = do_import(tmp_path, [bag])
    [log] = imported.written
    assert log.parent == tmp_path / "logs"
    assert [row[:2] for row in rows(log)] == [("robot", task)]
    runs = [bags.text(T - S, "/run", "../../../evil"), *TWO]
    mapping = '[run]\nby = "topic"\ntopic = "/run"\nname = { field = "data" }\n' + MAP
    [log] = do_import(tmp_path, [bags.write_mcap(tmp_path / "b.mcap", runs)], mapping).written
    assert log.parent == tmp_path / "logs"


def test_messages_that_make_no_sense_cost_only_themselves(tmp_path: Path) -> None:
    status = "/robot/do/_action/status"
    bad = [
        bags.Sent(T + n, status, bags.STATUS, data)
        for n, data in enumerate((b"", b"\0\1\0\0\xff\xff\xff\xff", b"x" * 99))
    ]
    back = bags.status_array(T + 20 * S, "/robot/do", [("late", 0, 2)])
    imported = do_import(tmp_path, [bags.write_mcap(tmp_path / "b.mcap", [*bad, *TWO, back])])
    assert rows(*imported.written)[:2] == ROWS[:2]
    assert set(codes(imported.diagnostics)) == {"undecodable_event", "goal_not_recorded"}


def test_the_command_tells_counts_and_how_it_went(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    bags.write_bag(tmp_path / "bag", TWO)
    assert main(["import", "bag", "bag", "--suggest"]) == 0
    suggested = capsys.readouterr().out
    assert 'task = { field = "goal.task" }' in suggested
    (tmp_path / "cell.toml").write_text(suggested)
    assert main(["import", "bag", "bag", "--map", "cell.toml", "-o", "logs"]) == 0
    assert capsys.readouterr().out == "1 run, 3 executions: 1 log written to logs, 0 there already\n"
    assert main(["import", "bag", "bag", "--map", "cell.toml"]) == 2
    assert main(["import", "bag", "bag", "-o", "logs"]) == 1
    assert "--suggest" in capsys.readouterr().err
    (tmp_path / "torn.mcap").write_bytes((tmp_path / "bag" / "bag_0.mcap").read_bytes()[:-200])
    assert main(["import", "bag", "torn.mcap", "--map", "cell.toml", "-o", "torn"]) == 3


def test_the_sample_bag_is_the_runs_of_the_campaign_that_it_was_made_of(tmp_path: Path) -> None:
    samples = Path(hrclog.sample_logs.__file__).parent
    folder = samples / "ros2_actions"
    imported = do_import(tmp_path, [folder / "tuesday"], (folder / "cell.toml").read_text())
    assert imported.diagnostics == []
    runs = sorted((samples / "campaign").glob("*.mcap"))[:6]
    assert imported.runs == [run.stem for run in runs]
    for run, log in zip(runs, imported.written, strict=True):
        assert rows(log) == rows(run)
        speeds = [read_logs([path]).events.filter(kind="safety_state_changed", agent="robot") for path in (run, log)]
        assert speeds[0]["speed_scale"].to_list() == pytest.approx(speeds[1]["speed_scale"].to_list())


def test_logs_of_hrclog_among_bags_are_no_bags(tmp_path: Path) -> None:
    bags.write_bag(tmp_path / "bag", TWO)
    do_import(tmp_path, [tmp_path / "bag"])
    with pytest.raises(LogReadError, match="a log of hrclog, which needs no import"):
        do_import(tmp_path, [tmp_path / "logs"])
    both = do_import(tmp_path, [tmp_path / "bag", tmp_path / "logs"])
    assert (len(both.unchanged), codes(both.diagnostics)) == (1, ["unread_logs"])
