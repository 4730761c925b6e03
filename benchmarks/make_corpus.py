"""Make tests/corpus: small damaged logs, two of each kind of `mutants.py`, and what reading each gives.

`python benchmarks/make_corpus.py` writes the archive anew; `--expect` only what reading gives, to be looked at before
it is kept. A file that the fuzzer found goes beside the archive as it is, and `--expect` after it.
"""

from __future__ import annotations

import io
import json
import sys
import tarfile
import tempfile
from pathlib import Path
from random import Random
from unittest.mock import patch

sys.path.append(str(Path(__file__).parents[1] / "tests" / "helpers"))

from damaged_corpus import ARCHIVE, CORPUS, damaged_files
from mutant_bases import make_bases
from mutant_readers import read_ours
from mutants import FAMILIES, mutant

SEED = 16
N_EACH = 2


def made() -> dict[str, bytes]:
    """Return damaged files by name."""
    files: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory() as folder, patch("mutant_bases._N_TASKS", 3):
        bases = make_bases(Path(folder))
    for family, kinds in FAMILIES.items():
        for kind in kinds:
            for number in range(N_EACH):
                chance = Random(f"{SEED}:{family}:{kind}:{number}")  # noqa: S311 - no secret
                data = None
                while data is None:
                    base = chance.choice(bases)
                    data = mutant(base, family, kind, chance)
                name = f"{kind}-{number}-{base.name}".replace(",", "").replace(" ", "-")
                files[f"{name}{base.suffix}"] = data
    return files


def write_archive(files: dict[str, bytes]) -> None:
    """Write an archive that depends on the files alone."""
    with tarfile.open(ARCHIVE, "w:xz", preset=9) as archive:
        for name, data in sorted(files.items()):
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            archive.addfile(entry, io.BytesIO(data))


def expectations() -> dict[str, list[object]]:
    """Return exit code and diagnostics of every file."""
    found: dict[str, list[object]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, data in sorted(damaged_files().items()):
            path = Path(folder, name)
            path.write_bytes(data)
            reading = read_ours(path)
            found[name] = [reading.code, *reading.codes, *filter(None, [reading.untyped])]
    return found


def main() -> None:
    """Write the archive, unless only what is expected is asked for, and that."""
    CORPUS.mkdir(exist_ok=True)
    if "--expect" not in sys.argv:
        write_archive(made())
    lines = (f" {json.dumps(name)}: {json.dumps(codes)}" for name, codes in expectations().items())
    (CORPUS / "expect.json").write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
