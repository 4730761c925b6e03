"""Look for failures by chance, as long as one likes: damaged files, random bytes, and the life of a run.

`python benchmarks/fuzz.py --minutes 60 --seed 7` tries in turn: mutants of whole files (`mutants.py`), files changed at
many places at once (from `tests/corpus` and those whole files), and runs that are recorded, killed, recovered and
annotated in any order. A finding goes to a folder, as a file to be read and a text with the command that repeats it.
`--file PATH` reads one file as the fuzzer does; `--atheris` lets atheris, where it is installed, guide the bytes by
what the reader executes.
"""

# ruff: noqa: E402 - what tests share is on the path first
from __future__ import annotations

import argparse
import contextlib
import io
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from random import Random
from typing import Final

ROOT: Final = Path(__file__).parents[1]
sys.path.append(str(ROOT / "tests" / "helpers"))
from damaged_corpus import damaged_files
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.stateful import run_state_machine_as_test
from mutant_readers import read_our_events, read_ours, recover_ours
from recording_machine import RecordingMachine
from reliability import LARGEST_MB, LONGEST_S, cases, mutant_of, try_shard

N_MUTANTS: Final = 15
N_BYTES: Final = 25
N_LIVES: Final = 2
STEPS: Final = 20
MOST_CHANGES: Final = 12
BOUNDARIES: Final = (0, 1, 0xFF, 2**16 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1)

Finding = tuple[str, str, bytes]
"""Name, what is wrong, and the file, if there is one."""


def mutants(number: int, chance_seed: int) -> Iterator[Finding]:
    """Try mutants of whole files: nothing untyped, costly or wrong without a word."""
    first = number * N_MUTANTS
    _, notes = try_shard(first, first + N_MUTANTS, chance_seed)
    for note in notes:
        wrong = {key: note[key] for key in ("untyped", "costly", "laundered", "disagrees") if key in note}
        if "silent" in note and "unprotected" not in note:
            wrong["silent"] = note["silent"]
        if wrong:
            text = f"{note['base']}, {note['kind']}: {wrong}"
            yield f"mutant-{note['number']}", text, mutant_of(note["number"], chance_seed)


def changed_bytes(number: int, chance_seed: int) -> Iterator[Finding]:
    """Change files at many places at once: whatever is read, errors are typed and cost is bounded."""
    files = _files()
    for index in range(N_BYTES):
        chance = Random(f"{chance_seed}:{number}:{index}")  # noqa: S311 - no secret
        data = _changed(chance.choice(files), chance.choice(files), chance)
        wrong = judged(data, chance.choice((".mcap", ".mcap.partial")))
        if wrong:
            yield f"bytes-{number}-{index}", wrong, data


def lives(number: int, chance_seed: int) -> Iterator[Finding]:
    """Let runs go through anything, beside a model of them."""
    options = settings(
        max_examples=N_LIVES,
        stateful_step_count=STEPS,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=list(HealthCheck),
        print_blob=False,
    )
    machine = seed(chance_seed * 1_000_003 + number)(type("Machine", (RecordingMachine,), {}))
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output):
            run_state_machine_as_test(machine, settings=options)
    except Exception:  # noqa: BLE001 - whatever it is, it is what is looked for
        yield f"life-{number}", f"{traceback.format_exc()}\n{output.getvalue()}", b""


KINDS: Final[dict[str, Callable[[int, int], Iterator[Finding]]]] = {
    "mutants": mutants,
    "bytes": changed_bytes,
    "lives": lives,
}


def judged(data: bytes, suffix: str) -> str:
    """Return what is wrong with how a file is read and recovered, "" for nothing."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"file{suffix}")
        path.write_bytes(data)
        readings = {
            "read": read_ours(path),
            "read events": read_our_events(path),
            "recover": recover_ours(path, Path(folder, "recovered.mcap")),
        }
    wrong = [f"{what}: {reading.untyped}" for what, reading in readings.items() if reading.untyped]
    wrong += [
        f"{what}: {reading.cpu_s:.1f} s, {reading.peak_mb:.0f} MB"
        for what, reading in readings.items()
        if reading.cpu_s > LONGEST_S or reading.peak_mb > LARGEST_MB
    ]
    return "; ".join(wrong)


@lru_cache
def _files() -> list[bytes]:
    return [*damaged_files().values(), *(case.base.data for case in cases())]


def _changed(data: bytes, other: bytes, chance: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.randrange(1, MOST_CHANGES)):
        at = chance.randrange(len(changed) + 1)
        size = chance.choice((1, 2, 4, 8, 9, 64, 500))
        match chance.randrange(6):
            case 0:
                changed[at : at + size] = chance.randbytes(size)
            case 1:
                width = chance.choice((1, 2, 4, 8))
                changed[at : at + width] = (chance.choice(BOUNDARIES) % 256**width).to_bytes(width, "little")
            case 2:
                del changed[at : at + size]
            case 3:
                begin = chance.randrange(len(other) + 1)
                changed[at:at] = other[begin : begin + size * 4]
            case 4:
                changed[at:at] = changed[at : at + size * 8]
            case _:
                changed[at : at + size] = bytes(size)
    return bytes(changed)


def keep(folder: Path, finding: Finding, command: str) -> None:
    """Write a finding into a folder, with the command that repeats it."""
    name, text, data = finding
    folder.mkdir(parents=True, exist_ok=True)
    if data:
        (folder / f"{name}.mcap").write_bytes(data)
    (folder / f"{name}.txt").write_text(f"{command}\n\n{text}\n", encoding="utf-8")
    print(f"{folder / name}: {text.strip().splitlines()[-1][:200]}\n  {command}", flush=True)


def fuzz(options: argparse.Namespace) -> int:
    """Try kinds in turn until the time is over; return how many findings there were."""
    until = time.monotonic() + options.minutes * 60
    kinds = [options.only] if options.only else list(KINDS)
    counts: Counter[str] = Counter()
    number = options.first
    while time.monotonic() < until and (options.rounds is None or number < options.first + options.rounds):
        for kind in kinds:
            if time.monotonic() >= until:
                break
            command = f"python benchmarks/fuzz.py --only {kind} --seed {options.seed} --first {number} --rounds 1"
            for finding in KINDS[kind](number, options.seed):
                keep(options.output, finding, command)
                counts["findings"] += 1
            counts[kind] += 1
        number += 1
    tried = f"{counts['mutants'] * N_MUTANTS} mutants, {counts['bytes'] * N_BYTES} files of changed bytes"
    print(f"seed {options.seed}: {tried}, {counts['lives'] * N_LIVES} lives of runs; {counts['findings']} findings")
    return counts["findings"]


def guided(options: argparse.Namespace) -> None:
    """Let atheris choose the bytes; it stops at the first finding, and leaves its file in the folder."""
    import atheris  # type: ignore[import-not-found,import-untyped,unused-ignore]

    options.output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as corpus:
        for index, data in enumerate(_files()):
            Path(corpus, str(index)).write_bytes(data)

        def try_bytes(data: bytes) -> None:
            wrong = judged(data, ".mcap")
            if wrong:
                raise RuntimeError(wrong)

        arguments = [f"-max_total_time={round(options.minutes * 60)}", f"-seed={options.seed}", "-max_len=65536"]
        _instrument(atheris)
        atheris.Setup([sys.argv[0], *arguments, f"-artifact_prefix={options.output}/atheris-", corpus], try_bytes)
        atheris.Fuzz()


def _instrument(atheris: object) -> None:
    """Instrument the functions that read a log."""
    names = ("hrclog.log.mcap", "hrclog.log.messages", "hrclog.log.recover", "hrclog.log.parts")
    for module in [sys.modules[name] for name in list(sys.modules) if name.startswith(names)]:
        for name, value in list(vars(module).items()):
            if callable(value) and getattr(value, "__module__", "") == module.__name__ and hasattr(value, "__code__"):
                setattr(module, name, atheris.instrument_func(value))  # type: ignore[attr-defined]


def main() -> int:
    """Return 1 if something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=KINDS)
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--rounds", type=int, help="how many rounds; default as many as there is time for")
    parser.add_argument("--file", type=Path, help="only read this file")
    parser.add_argument("--atheris", action="store_true", help="bytes guided by atheris")
    parser.add_argument("-o", "--output", type=Path, default=Path("fuzz-findings"), help="folder of findings")
    options = parser.parse_args()
    if options.file:
        wrong = judged(options.file.read_bytes(), "".join(options.file.suffixes[-2:]))
        print(wrong or "nothing is wrong")
        return bool(wrong)
    if options.atheris:
        guided(options)
        return 0
    return fuzz(options) > 0


if __name__ == "__main__":
    sys.exit(main())
