"""Tell from the first bytes of a file whether it is a table, and which preset is made for it; loads nothing heavy."""

from __future__ import annotations

import codecs
import csv
import json
import re
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any, Final

ENDING: Final = ".toml"
"""Of the files of presets."""

_COLUMNAR: Final = (b"PAR1", b"ARROW1", b"\xff\xff\xff\xff")
_ARCHIVE: Final = b"PK\x03\x04"
_OLD_WORKBOOK: Final = b"\xd0\xcf\x11\xe0"
_WORKBOOKS: Final = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods")
_TEXTS: Final = (".csv", ".tsv", ".tab")
_MARKS: Final = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_DELIMITERS: Final = "\t,;|"
_MOST_LINES: Final = 60
_FEWEST_ALIKE: Final = 0.8  # of the lines of a table; prose has lines of any number of commas
_TIME: Final = re.compile(r"[0-9][0-9:.,]*")
_BETWEEN: Final = "\ufeff \t\r\n,["

_Rows = Sequence[Sequence[str]]


def preset_names() -> list[str]:
    """Return the names of all presets."""
    return sorted(entry.name.removesuffix(ENDING) for entry in _folder().iterdir() if str(entry.name).endswith(ENDING))


def preset_text(name: str) -> str:
    """Return the TOML text of a preset."""
    text: str = _folder().joinpath(name + ENDING).read_text(encoding="utf-8")
    return text


def _folder() -> Any:  # noqa: ANN401 - whatever a package's files are reached by
    return files(__package__).joinpath("presets")


def is_table(head: bytes, name: str) -> bool:
    """Return whether a file looks like a table.

    Args:
        head: its first bytes.
        name: of the file, in small letters.
    """
    if head.startswith(_COLUMNAR):
        return True
    if head.startswith((_ARCHIVE, _OLD_WORKBOOK)):
        return name.endswith(_WORKBOOKS)
    text = _text(head)
    if text.lstrip(_BETWEEN).startswith("{"):
        return _holds_flat_objects(text)
    return any(_is_even(rows) for rows in _readings(text)) or (
        name.endswith(_TEXTS) and any(len(row) > 1 for rows in _readings(text) for row in rows)
    )


def preset_for(head: bytes) -> str:
    """Return the name by which the preset made for a text file is chosen, "" if none is."""
    readings = _readings(_text(head))
    for name in preset_names():
        preset = tomllib.loads(preset_text(name))
        if any(_fits(preset, rows) for rows in readings):
            return name.partition("-")[0]
    return ""


def _fits(preset: Mapping[str, Any], rows: _Rows) -> bool:
    match = preset.get("match", {})
    if columns := set(match.get("columns", ())):
        return any(columns.issubset(map(str.strip, row)) for row in rows)
    n_columns = match.get("n_columns")
    if not n_columns:
        return False
    wide = [row for row in rows if len(row) > 1]
    places = [int(preset["columns"][role].removeprefix("#")) - 1 for role in ("start", "end")]
    return bool(wide) and all(
        len(row) == n_columns and all(_TIME.fullmatch(row[place].strip()) for place in places) for row in wide
    )


def _text(head: bytes) -> str:
    """Return the text of the first bytes, "" where they are none."""
    encoding = next((name for mark, name in _MARKS if head.startswith(mark)), "")
    text = head.decode(encoding or "utf-8", errors="replace")
    is_text = encoding or not (0 in head or text.count("\ufffd") > len(text) // 4)
    return text if is_text else ""


def _readings(text: str) -> list[list[list[str]]]:
    """Return the first lines of a text as rows of cells, for each delimiter."""
    lines = [line for line in text.splitlines()[:_MOST_LINES] if line.strip()]
    return [_rows(lines, sign) for sign in _DELIMITERS]


def _rows(lines: Sequence[str], delimiter: str) -> list[list[str]]:
    try:
        return list(csv.reader(lines, delimiter=delimiter))
    except csv.Error:
        return []


def _is_even(rows: _Rows) -> bool:
    """Return whether most rows have the same number of cells, more than one."""
    if not rows:
        return False
    width, count = Counter(map(len, rows)).most_common(1)[0]
    return width > 1 and len(rows) > 1 and count >= _FEWEST_ALIKE * len(rows)


def _holds_flat_objects(text: str) -> bool:
    """Return whether JSON objects without further ones in them stand one behind the other."""
    decoder, at, n_flat = json.JSONDecoder(), 0, 0
    while n_flat < 2:
        at += len(text[at:]) - len(text[at:].lstrip(_BETWEEN))
        try:
            value, at = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            break
        if not isinstance(value, dict) or not all(map(_is_cell, value.values())):
            return False
        n_flat += 1
    return n_flat > 1 or (n_flat == 1 and text.lstrip("\ufeff \t\r\n").startswith("["))


def _is_cell(value: Any) -> bool:  # noqa: ANN401 - any JSON value
    """Return whether a value has a place in a table: lists do, where they hold no objects."""
    return not any(isinstance(item, dict) for item in (value if isinstance(value, list) else [value]))
