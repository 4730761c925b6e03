"""Fail if a test was skipped that .ci/allowed-skips does not allow."""

from __future__ import annotations

import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path


def main(report: str) -> int:
    """Return 1 and print the skips that are not allowed, else 0."""
    lines = Path(__file__).with_name("allowed-skips").read_text(encoding="utf-8").splitlines()
    allowed = [re.compile(line) for line in lines if line.strip() and not line.startswith("#")]
    cases = ET.parse(report).getroot().iter("testcase")  # noqa: S314 - pytest's own report
    skips = [
        f"{case.get('classname')}::{case.get('name')}: {skip.get('message')}"
        for case in cases
        for skip in case.findall("skipped")
        if skip.get("type") == "pytest.skip"
    ]
    refused = [skip for skip in skips if not any(pattern.search(skip) for pattern in allowed)]
    for skip in refused:
        sys.stderr.write(f"skipped but not allowed: {skip}\n")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
