"""`hrclog analyze` end to end, and what start-up costs."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from measure import child_cpu_seconds


def command(*arguments: str) -> float:
    """Return the CPU time of a call of the command line."""
    call = [sys.executable, "-m", "hrclog", *arguments]
    return child_cpu_seconds(lambda: subprocess.run(call, check=True, capture_output=True))


def main(logs: list[str]) -> None:
    """Print CPU times: start-up, then analyses of the folders given or of simulated campaigns."""
    rows = [("python -c pass", child_cpu_seconds(lambda: subprocess.run([sys.executable, "-c", "pass"], check=True)))]
    rows.append(("hrclog --help", command("--help")))
    with tempfile.TemporaryDirectory() as folder:
        for runs in (1, 50, 200):
            target = str(Path(folder) / str(runs))
            command_once = [sys.executable, "-m", "hrclog", "sim", "--runs", str(runs), "-o", target]
            subprocess.run(command_once, check=True, capture_output=True)
            rows.append((f"hrclog analyze, {runs} simulated runs", command("analyze", target, "-o", f"{target}-out")))
        rows += [(f"hrclog analyze {log}", command("analyze", log, "-o", str(Path(folder) / "out"))) for log in logs]
    print("| command | CPU s |\n| --- | --- |")
    print("\n".join(f"| {name} | {cost:.2f} |" for name, cost in rows))


if __name__ == "__main__":
    main(sys.argv[1:])
