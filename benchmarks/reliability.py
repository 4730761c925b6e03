"""The figures of docs/reliability.md: SIGKILLs of everything that writes, and damaged files of every kind.

`PYTHONPATH=CHECKOUT python benchmarks/reliability.py --mutants 300 --kills 50` tries the hrclog of any checkout;
`--keep NUMBER` writes one mutant of a seed into a file.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path
from random import Random
from typing import Any, Final

sys.path.append(str(Path(__file__).parents[1] / "tests" / "helpers"))

from kills import kill_many
from mutant_bases import make_bases, whole_or_raise
from mutant_readers import PEERS, Reading, check_ours, read_our_events, read_ours, recover_ours, same_facts
from mutants import KINDS, Base, mutant

import hrclog

PAGE: Final = Path(__file__).parents[1] / "docs" / "reliability.md"
LONGEST_S: Final = 5.0
LARGEST_MB: Final = 500.0
SHARD: Final = 100
CHECK_EVERY: Final = 20  # mutants; to the others the exit code is that of the findings
MOST_MEMORY: Final = 6 << 30  # bytes; more would hurt the machine

Count = Counter[tuple[str, ...]]

TABLE: Final = {
    "mutants": "mutants",
    "exit 0, other facts": "silent",
    "of these `unprotected`": "unprotected",
    "earlier end, `unfinished_log`": "unfinished",
    "untyped error": "untyped",
    "over 5 s or 500 MB": "costly",
    "recovered looks cleaner": "laundered",
}
"""Columns of the table of mutants, and what they count."""


class Case:
    """A base, and what readers make of it undamaged."""

    def __init__(self, base: Base, folder: Path) -> None:
        self.base = base
        self.path = folder / f"whole{base.suffix}"
        whole_or_raise(base, self.path)
        self.facts = read_ours(self.path).facts
        peer_path = folder / "whole.mcap"
        peer_path.write_bytes(base.data)
        self.peers = {name: read(peer_path) for name, read in PEERS.items()}


@lru_cache
def cases() -> list[Case]:
    """Return the bases, made once in each process."""
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    with tempfile.TemporaryDirectory() as folder:
        return [Case(base, Path(folder)) for base in make_bases(Path(folder))]


def try_shard(first: int, last: int, seed: int) -> tuple[Count, list[dict[str, Any]]]:
    """Return the counts of some mutants, and those of note."""
    counts: Count = Counter()
    notes: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(first, last):
            case, family, kind, data = _mutant(number, seed)
            results = _judged(case, data, number, Path(folder))
            key = ("with" if case.base.protected else "without", family, kind, case.base.name)
            counts.update((*key, result) for result in ("mutants", *results))
            if results.keys() & {"silent", "untyped", "costly", "laundered", "disagrees"}:
                notes.append({"number": number, "base": case.base.name, "kind": kind, **results})
    return counts, notes


def _mutant(number: int, seed: int) -> tuple[Case, str, str, bytes]:
    chance = Random(f"{seed}:{number}")  # noqa: S311 - no secret
    while True:
        case = chance.choice(cases())
        family, kind = chance.choice(KINDS)
        data = mutant(case.base, family, kind, chance)
        if data is not None:
            return case, family, kind, data


def mutant_of(number: int, seed: int) -> bytes:
    """Return a mutant of a seed."""
    return _mutant(number, seed)[3]


def _judged(case: Case, data: bytes, number: int, folder: Path) -> dict[str, str]:
    """Return what is to be counted of a mutant, each with a remark."""
    path = folder / f"mutant{case.base.suffix}"
    path.write_bytes(data)
    reading, events = read_ours(path), read_our_events(path)
    results = _ours(case, data, reading, events)
    if number % CHECK_EVERY == 0 and (code := check_ours(path)) != reading.code:
        results["disagrees"] = f"`hrclog check` exits {code}, reading {reading.code}"
    target = folder / "recovered.mcap"
    recovered = recover_ours(path, target)
    if reading.code == 3 and recovered.code == 0 and not same_facts(recovered.facts, case.facts):
        results["laundered"] = ", ".join(reading.codes)
    if recovered.untyped:
        results["untyped"] = f"recover: {recovered.untyped}"
    results |= _cost("recover", recovered) | _cost("read", reading)
    peer_path = folder / "peer.mcap"
    peer_path.write_bytes(data)
    for name, read in PEERS.items():
        results |= _peer(name, read(peer_path), case.peers[name])
    for leftover in folder.iterdir():
        leftover.unlink()
    return results


def _ours(case: Case, data: bytes, reading: Reading, events: Reading) -> dict[str, str]:
    results: dict[str, str] = {}
    silent = [
        name
        for name, found, whole in (("all", reading, case.facts), ("events only", events, case.facts[:1]))
        if found.code == 0 and not same_facts(found.facts, whole)
    ]
    if silent and case.base.is_earlier_end(data) and "unfinished_log" in reading.codes:
        results["unfinished"] = ""
    elif silent:
        results["silent"] = f"{', '.join(silent)}: {_difference(reading, case)}; told: {', '.join(reading.codes)}"
        if "unprotected" in reading.codes:
            results["unprotected"] = ""
    if untyped := reading.untyped or events.untyped:
        results["untyped"] = untyped
    return results


def _difference(reading: Reading, case: Case) -> str:
    if reading.facts is None:
        return "events only"
    return "{:+d} events, {:+d} samples".format(
        *(found.height - whole.height for found, whole in zip(reading.facts, case.facts, strict=True))
    )


def _cost(what: str, reading: Reading) -> dict[str, str]:
    if reading.cpu_s <= LONGEST_S and reading.peak_mb <= LARGEST_MB:
        return {}
    return {"costly": f"{what}: {reading.cpu_s:.1f} s, {reading.peak_mb:.0f} MB"}


def _peer(name: str, reading: Reading, whole: Reading) -> dict[str, str]:
    results: dict[str, str] = {}
    if reading.code == 0 and not same_facts(reading.facts, whole.facts):
        results[f"{name} silent"] = ""
    if reading.untyped:
        results[f"{name} untyped"] = ""
    if reading.cpu_s > LONGEST_S or reading.peak_mb > LARGEST_MB:
        results[f"{name} costly"] = ""
    return results


def try_mutants(n_mutants: int, seed: int, workers: int) -> tuple[Count, list[dict[str, Any]]]:
    """Return the counts of all mutants, and those of note in order."""
    counts: Count = Counter()
    notes: list[dict[str, Any]] = []
    shards = [(first, min(first + SHARD, n_mutants)) for first in range(0, n_mutants, SHARD)]
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        futures = [pool.submit(try_shard, first, last, seed) for first, last in shards]
        for done, future in enumerate(futures, 1):
            part, part_notes = future.result()
            counts.update(part)
            notes += part_notes
            _progress("mutants", min(done * SHARD, n_mutants), n_mutants)
    return counts, notes


def _progress(what: str, done: int, total: int) -> None:
    if sys.stderr.isatty() or done == total:
        end = "\n" if done == total else ""
        print(f"\r{what} {done:,}/{total:,}", end=end, file=sys.stderr, flush=True)


def mutant_table(counts: Count) -> str:
    """Return the counts of our reader by protection and family as a markdown table."""
    lines = ["| checksums | damage | " + " | ".join(TABLE) + " |", "| --- | --- |" + " --- |" * len(TABLE)]
    for group in sorted({key[:2] for key in counts}):
        totals = (_total(counts, group, what) for what in TABLE.values())
        lines.append(f"| {group[0]} | {group[1]} | " + " | ".join(f"{total:,}" for total in totals) + " |")
    return "\n".join(lines)


def peer_table(counts: Count) -> str:
    """Return what the readers make of the same files as a markdown table."""
    header = ("silently other facts", "untyped error", "over 5 s or 500 MB")
    lines = [f"| reader | checksums | mutants | {' | '.join(header)} |", "| --- |" + " --- |" * (len(header) + 2)]
    for prefix in ("", *(f"{name} " for name in PEERS)):
        for group in sorted({key[:1] for key in counts}):
            whats = ("mutants", *(f"{prefix}{what}" for what in ("silent", "untyped", "costly")))
            cells = " | ".join(f"{_total(counts, group, what):,}" for what in whats)
            lines.append(f"| {prefix.strip() or 'hrclog'} | {group[0]} | {cells} |")
    return "\n".join(lines)


def _total(counts: Count, group: tuple[str, ...], what: str) -> int:
    return sum(n for key, n in counts.items() if key[: len(group)] == group and key[-1] == what)


def silent_table(counts: Count, notes: list[dict[str, Any]]) -> str:
    """Return each kind of damage that gives other facts without a word, or is laundered, with an example."""
    kinds = sorted({key[:4] for key in counts if key[-1] in ("silent", "laundered")})
    if not kinds:
        return "None."
    lines = ["| checksums | base | kind | mutants | silent | laundered | example |", "| --- |" + " --- |" * 6]
    for key in kinds:
        protection, _, kind, base = key
        n_all, n_silent, n_laundered = (counts[(*key, what)] for what in ("mutants", "silent", "laundered"))
        remarks = (
            f"{note['number']}: {note.get('silent') or note.get('laundered')}"
            for note in notes
            if (note["base"], note["kind"]) == (base, kind) and note.keys() & {"silent", "laundered"}
        )
        lines.append(f"| {protection} | {base} | {kind} | {n_all} | {n_silent} | {n_laundered} | {next(remarks, '')} |")
    return "\n".join(lines)


def kill_table(rows: list[dict[str, Any]]) -> str:
    """Return kills by situation as a markdown table, with a sum."""
    names = ("kills", "acknowledged", "lost", "faulty")
    lines = ["| killed | kills | acknowledged | of these lost | unreadable or wrong |", "| --- |" + " --- |" * 4]
    total = {"situation": "all", **{name: sum(row[name] for row in rows) for name in names}}
    lines += [
        f"| {row['situation']} | " + " | ".join(f"{row[name]:,}" for name in names) + " |" for row in (*rows, total)
    ]
    return "\n".join(lines)


def _as_rows(counts: Count) -> Iterator[dict[str, Any]]:
    for key in sorted({key[:4] for key in counts}):
        names = dict(zip(("checksums", "family", "kind", "base"), key, strict=True))
        yield names | {found[-1]: n for found, n in sorted(counts.items()) if found[:4] == key}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mutants", type=int, default=30_000)
    parser.add_argument("--kills", type=int, default=1_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--keep", type=int, metavar="NUMBER", help="only write this mutant, beside the whole file")
    parser.add_argument("--write", action="store_true", help="put the tables into docs/reliability.md")
    parser.add_argument("-o", "--output", type=Path, help="a JSON file with all counts")
    return parser.parse_args()


def _keep(number: int, seed: int) -> None:
    case, _, kind, data = _mutant(number, seed)
    for name, content in ((f"mutant-{number}", data), ("whole", case.base.data)):
        Path(f"{name}{case.base.suffix}").write_bytes(content)
    print(f"mutant-{number}{case.base.suffix}: {case.base.name}, {kind}; whole{case.base.suffix}")


def _replaced(page: str, name: str, text: str) -> str:
    """Return a page with other text between the marks of a name."""
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    return re.sub(f"{re.escape(begin)}.*?{re.escape(end)}", lambda _: f"{begin}\n{text}\n{end}", page, flags=re.DOTALL)


def _write(name: str, text: str) -> None:
    PAGE.write_text(_replaced(PAGE.read_text(encoding="utf-8"), name, text), encoding="utf-8")


def main() -> None:
    """Print the tables; write all counts and notes as JSON."""
    options = _options()
    if options.keep is not None:
        _keep(options.keep, options.seed)
        return
    document: dict[str, Any] = {"hrclog": str(Path(hrclog.__file__).parent), "seed": options.seed}
    print(f"{document['hrclog']}, seed {options.seed}")
    if options.kills:
        folder = Path(tempfile.mkdtemp(prefix="hrclog-kills-"))
        done = iter(range(1, options.kills + 1))
        rows = kill_many(options.kills, options.seed, folder, lambda: _progress("kills", next(done), options.kills))
        document["kills"] = rows
        text = kill_table(rows)
        print(f"\n{text}", *(f"{row['situation']}: {fault}" for row in rows for fault in row["faults"][:5]), sep="\n")
        if options.write:
            _write("kills", text)
    if options.mutants:
        counts, notes = try_mutants(options.mutants, options.seed, options.workers)
        document |= {"mutants": list(_as_rows(counts)), "notes": notes}
        tables = mutant_table(counts), peer_table(counts), silent_table(counts, notes)
        print("", *tables, *_remarks(notes), sep="\n\n")
        if options.write:
            for name, text in zip(("mutants", "peers", "silent"), tables, strict=True):
                _write(name, text)
    if options.output:
        options.output.write_text(json.dumps(document, indent=1), encoding="utf-8")


def _remarks(notes: list[dict[str, Any]]) -> list[str]:
    return [
        f"{note['number']}: {note['base']}, {note['kind']}: {note[what]}"
        for note in notes
        for what in ("untyped", "costly", "disagrees")
        if what in note
    ]


if __name__ == "__main__":
    main()
