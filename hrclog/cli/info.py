"""`hrclog info`: what a log holds, and what any MCAP file is."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import click

from hrclog.cli.clock_option import clock_option
from hrclog.cli.common import echo, echo_lines, json_option, logs_argument, number, print_json, printable, table, tell
from hrclog.cli.hints import hinted, import_line
from hrclog.cli.where_option import where_option
from hrclog.wording import counted

if TYPE_CHECKING:
    from pathlib import Path

    from hrclog.diagnostic import Diagnostic
    from hrclog.log.logs import Logs
    from hrclog.log.mcap.description import Description
    from hrclog.log.topics import PartFacts

Parts: TypeAlias = "dict[Path, PartFacts]"
"""What the files of a recording are."""

_MOST_DESCRIBED: Final = 3
"""Files whose channels the text lists; more would hide the table of runs."""

_KINDS: Final = {"MCAP": "MCAP", "OTHER": "MCAP", "SQLITE": "SQLite of ROS 2", "ROS1": "bag of ROS 1"}


@click.command(name="info")
@logs_argument
@clock_option
@where_option
@json_option
def command(logs: tuple[str, ...], clocks: dict[str, int], conditions: tuple[str, ...], as_json: bool) -> int:
    """Show what logs hold: files, runs, agents, events, span, and whether they were closed.

    Lists the topics of any recording - MCAP, ROS 2 or ROS 1 bag - with types and numbers of messages, and describes any
    MCAP file: profile, channels, schemas, times, chunks, compression, indexes, attachments, metadata.

    \b
    Example:
      hrclog info run.mcap
    """
    from hrclog.log.reader import read_logs

    read = read_logs(logs, signals=True, clocks=clocks, where=conditions)
    recordings = {path: _described(path) for path in read.paths}
    diagnostics = _diagnostics(read, recordings)
    files, runs = _files(read), _runs(read)
    if as_json:
        print_json(
            {
                "files": files,
                "runs": runs,
                "recordings": [_as_dict(path, parts) for path, parts in recordings.items() if parts],
                "mcap": [
                    {"path": str(file), **part.description.as_dict()}
                    for parts in recordings.values()
                    for file, part in parts.items()
                    if part.description
                ],
                "diagnostics": [finding.as_dict() for finding in hinted(diagnostics)],
            }
        )
    else:
        echo_lines(_file_table(files))
        if len(files) <= _MOST_DESCRIBED:
            for path, parts in recordings.items():
                if parts:
                    _show_recording(path, parts)
        else:
            echo()
            echo(f"(topics are shown of up to {_MOST_DESCRIBED} logs at a time; --json lists all)")
        if runs:
            echo()
            echo_lines(_run_table(runs))
    return tell(diagnostics)


def _described(path: Path) -> Parts:
    """Return what each file of a recording is, those left out that cannot be read."""
    from hrclog.log.topics import part_facts, parts_at

    return {file: facts for file in parts_at(path) if (facts := part_facts(file))}


def _as_dict(path: Path, parts: Parts) -> dict[str, Any]:
    from hrclog.log.topics import all_topics

    topics = all_topics(parts.values())
    return {
        "path": str(path),
        "formats": sorted({part.kind.name.lower() for part in parts.values()}),
        "n_messages": sum(facts.n_messages for facts in topics),
        "topics": [asdict(facts) for facts in topics],
    }


def _diagnostics(read: Logs, recordings: dict[Path, Parts]) -> list[Diagnostic]:
    """Return what reading found, and damage where only the description looks; a file may be without our events."""
    from hrclog.diagnostic import Diagnostic

    paths = {str(path) for path, parts in recordings.items() if parts}
    findings = [
        finding
        for finding in read.diagnostics
        if finding.code not in ("no_events", "not_imported") or finding.path not in paths
    ]
    damaged = {finding.path for finding in findings if finding.severity == "error"}
    findings += [
        Diagnostic(problem.code, problem.message, str(file), offset=problem.offset)
        for parts in recordings.values()
        for file, part in parts.items()
        if part.description and str(file) not in damaged
        for problem in part.description.problems
    ]
    return findings


def _files(read: Logs) -> list[dict[str, Any]]:
    unfinished = {
        finding.path for finding in read.diagnostics if finding.code in ("unfinished_log", "no_header", "truncated")
    }
    counts = dict(read.events.group_by("path").len().iter_rows())
    return [
        {
            "path": str(path),
            "bytes": path.stat().st_size if path.is_file() else sum(f.stat().st_size for f in path.iterdir()),
            "n_events": counts.get(str(path), 0),
            "finished": str(path) not in unfinished,
        }
        for path in read.paths
    ]


def _runs(read: Logs) -> list[dict[str, Any]]:
    import polars as pl

    from hrclog.analyzers.projections.intervals import intervals
    from hrclog.analyzers.projections.runs import runs
    from hrclog.analyzers.projections.tags import run_record
    from hrclog.log.runs.tags import run_tags

    events = read.events.group_by("run_id").agg(
        pl.len().alias("n_events"), pl.col("time_ns").min().alias("first_ns"), pl.col("time_ns").max().alias("last_ns")
    )
    counts = {row["run_id"]: row for row in events.iter_rows(named=True)}
    samples = dict(read.signals.group_by("run_id").len().iter_rows())
    tags = run_tags(read.events)
    return [
        run_record(row, tags) | counts[row["run_id"]] | {"n_signal_samples": samples.get(row["run_id"], 0)}
        for row in runs(read.events, intervals(read.events)).iter_rows(named=True)
    ]


def _file_table(files: list[dict[str, Any]]) -> str:
    rows = [(row["path"], str(row["bytes"]), str(row["n_events"]), "yes" if row["finished"] else "no") for row in files]
    return table(("file", "bytes", "events", "closed"), rows)


def _show_recording(path: Path, parts: Parts) -> None:
    """Print what a recording is: few MCAP files one by one, else the topics of all together; and how to import it."""
    from hrclog.log.messages.channels import EVENTS_TOPIC
    from hrclog.log.topics import all_topics

    topics = all_topics(parts.values())
    descriptions = {file: part.description for file, part in parts.items() if part.description}
    if len(descriptions) == len(parts) <= _MOST_DESCRIBED:
        for file, description in descriptions.items():
            echo()
            echo_lines(_described_text(file, description))
    else:
        kinds = " and ".join(sorted({_KINDS[part.kind.name] for part in parts.values()}))
        n_messages = counted(sum(facts.n_messages for facts in topics), "message")
        n_parts = f", {counted(len(parts), 'file')}" if path.is_dir() else ""
        echo()
        echo(f"{path}: {kinds}{n_parts}, {n_messages}")
        if topics:
            echo()
            echo_lines(_topic_table([(t.topic, t.type or "none", t.encoding, str(t.n_messages)) for t in topics]))
    if topics and not any(facts.topic.endswith(EVENTS_TOPIC) for facts in topics):
        line = import_line(path, logs_too=True)
        echo()
        echo(f"no events of hrclog in it; import it with `{line}`")


def _described_text(path: Path, facts: Description) -> str:
    """Return the main facts of a file as lines of text, and a table of its channels."""
    chunks = ", ".join(
        counted(count, f"chunk ({method or 'uncompressed'})", f"chunks ({method or 'uncompressed'})")
        for method, count in facts.chunks.compression.items()
    )
    span = "no times"
    if facts.start_ns is not None and facts.end_ns is not None:
        span = f"{_instant(facts.start_ns)} to {_instant(facts.end_ns)}"
    indexes = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in facts.indexes.items() if count)
    lines = [
        f"{path}: MCAP, profile {facts.profile or 'none'}, written by {facts.library or 'unknown'}",
        f"  {counted(facts.n_messages, 'message')}, {span}; {chunks or 'no chunks'}",
        f"  indexes: {indexes or 'none'}; summary: {_summary_text(facts)}",
        *(f"  attachment {item.name}: {item.media_type}, {item.n_bytes} bytes" for item in facts.attachments),
        *(f"  metadata {item.name}: {', '.join(item.values) or 'empty'}" for item in facts.metadata),
        *(
            f"  {counted(count, 'record')} of the unknown kind 0x{opcode:02x}"
            for opcode, count in facts.other_records.items()
        ),
    ]
    text = "\n".join(printable(line) for line in lines)
    return f"{text}\n\n{_channel_table(facts)}" if facts.channels else text


def _summary_text(facts: Description) -> str:
    if not facts.summary.start:
        return "none"
    return "with statistics" if facts.statistics else "without statistics"


def _channel_table(facts: Description) -> str:
    rows = [
        (channel.topic, channel.schema or "none", channel.message_encoding, str(channel.n_messages))
        for channel in facts.channels
    ]
    return _topic_table(rows)


def _topic_table(rows: list[tuple[str, str, str, str]]) -> str:
    return table(("topic", "type", "encoding", "messages"), rows, lambda i: i == 3)


def _run_table(runs: list[dict[str, Any]]) -> str:
    rows: list[tuple[str, ...]] = [
        (
            row["name"],
            _instant(row["first_ns"]),
            ", ".join(row["agents"]),
            str(row["n_executions"]),
            str(row["n_failed"]),
            str(row["n_open"]),
            number(row["makespan_s"], 1),
            row["outcome"] or "n/a",
        )
        for row in runs
    ]
    header: tuple[str, ...] = ("run", "began (UTC)", "agents", "executions", "failed", "open", "makespan s", "outcome")
    if any(row["tags"] for row in runs):
        header = (*header, "tags")
        tags = (", ".join(f"{key}={value}" for key, value in row["tags"].items()) for row in runs)
        rows = [(*row, text) for row, text in zip(rows, tags, strict=True)]
    return table(header, rows, lambda i: 2 < i < 7)


def _instant(time_ns: int) -> str:
    from datetime import UTC, datetime

    if not 0 <= time_ns < 4e18:
        return str(time_ns)
    return datetime.fromtimestamp(time_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
