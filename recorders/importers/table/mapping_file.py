"""Mappings as TOML files: written by `--save-map`, read by `--map`; presets are such files."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from hrclog.errors import HrclogError, ImportDataError
from hrclog.files import write_whole
from hrclog.recorders.importers.table.mapping import (
    SOURCE_FIELDS,
    WORD_FIELDS,
    Source,
    TableMapping,
    check_mapping,
    delimiter_of,
)

_MOST_BYTES: Final = 1 << 20
_TIMES: Final = ("timezone", "run_start", "unit", "date_order", "run_gap_s")
_TABLE: Final = ("delimiter", "encoding", "decimal", "sheet", "has_header")
_LISTS: Final = ("run", "tag_columns", "pair_by")
_SECTIONS: Final[dict[str, tuple[str, ...]]] = {
    "columns": (*SOURCE_FIELDS, *_LISTS, "tiers"),
    "times": _TIMES,
    "words": WORD_FIELDS,
    "table": _TABLE,
}
_TOP: Final = ("about", "match", "tags", *_SECTIONS)
_HEADER: Final = (
    "# What the columns of a table mean: hrclog import table FILE... --map THIS -o DIR (docs/tables-in.md)\n"
)


@dataclass(frozen=True, slots=True)
class MappingFile:
    """A mapping, and which tables it is for.

    Attributes:
        mapping: what the columns mean.
        about: one line on what writes such tables.
        columns: those that a table must have for this mapping to be proposed; empty for never.
        n_columns: how many columns a table without a header must have.
    """

    mapping: TableMapping
    about: str = ""
    columns: tuple[str, ...] = ()
    n_columns: int = 0


def read_mapping(path: Path) -> MappingFile:
    """Return the mapping of a TOML file.

    Raises:
        ImportDataError: the file cannot be read, or is no such mapping.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise ImportDataError(path, f"more than {_MOST_BYTES:,} bytes", "a mapping, TOML")
        text = data.decode()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ImportDataError(path, f"a file that cannot be read ({reason})", "a mapping, TOML") from error
    return parse_mapping(text, path)


def parse_mapping(text: str, path: Path) -> MappingFile:
    """Return the mapping of a TOML text.

    Args:
        text: of the file.
        path: its place, for errors.

    Raises:
        ImportDataError: it is no such mapping.
    """
    try:
        content = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ImportDataError(path, f"no TOML ({error})", "a mapping as --save-map writes it") from error
    try:
        mapping = _mapping_of(content)
        check_mapping(mapping)
        match = _part(content, "match")
        _refuse_others("match", match, ("columns", "n_columns"))
        return MappingFile(
            mapping,
            str(content.get("about", "")),
            _texts("match.columns", match.get("columns", [])),
            int(match.get("n_columns", 0)),
        )
    except (HrclogError, TypeError, ValueError) as error:
        raise ImportDataError(
            path, str(error).removeprefix("found "), "a mapping as docs/tables-in.md lists it"
        ) from error


def write_mapping(path: Path, mapping: TableMapping) -> None:
    """Write a mapping to a new file.

    Raises:
        HrclogError: the file exists already, or cannot be written.
    """
    try:
        write_whole(path, mapping_text(mapping).encode(), is_new=True)
    except FileExistsError as error:
        raise HrclogError(f"{path}: exists already, not overwriting it; choose another name for --save-map") from error
    except OSError as error:
        raise HrclogError(
            f"{path}: cannot be written ({error.strerror}); choose another place for --save-map"
        ) from error


def mapping_text(mapping: TableMapping) -> str:
    """Return a mapping as TOML, what is not set left out."""
    default = TableMapping()
    parts = [_HEADER]
    for section, names in _SECTIONS.items():
        values = {name: getattr(mapping, name) for name in names if getattr(mapping, name) != getattr(default, name)}
        if values:
            parts.append(f"\n[{section}]\n" + "".join(f"{name} = {_toml(value)}\n" for name, value in values.items()))
    if mapping.tags:
        parts.append("\n[tags]\n" + "".join(f"{_toml(key)} = {_toml(value)}\n" for key, value in mapping.tags.items()))
    return "".join(parts)


def _toml(value: object) -> str:
    match value:
        case bool() | int() | float():
            return repr(value).lower()
        case Source():
            if not value.pattern and not value.column.startswith("="):
                return _toml(str(value))
            pattern = f", pattern = {_toml(value.pattern)}" if value.pattern else ""
            return f"{{ column = {_toml(value.column)}{pattern} }}"
        case tuple():
            return f"[{', '.join(map(_toml, value))}]"
        case _:
            # a JSON text is a TOML text, but for DEL
            return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")


def _mapping_of(content: Mapping[str, Any]) -> TableMapping:
    _refuse_others("", content, _TOP)
    values: dict[str, Any] = {}
    for section, names in _SECTIONS.items():
        part = _part(content, section)
        _refuse_others(section, part, names)
        for name, value in part.items():
            values[name] = _value(f"{section}.{name}", name, value)
    tags = {str(key): _text(f"tags.{key}", value) for key, value in _part(content, "tags").items()}
    return TableMapping(**values, tags=tags)


def _value(place: str, name: str, value: Any) -> Any:  # noqa: ANN401 - any TOML value
    match name:
        case "run":
            return tuple(_source(place, part) for part in (value if isinstance(value, list) else [value]))
        case "run_gap_s":
            return _of_type(place, value, int | float, "seconds")
        case "has_header":
            return _of_type(place, value, bool, "true or false")
        case "delimiter":
            return delimiter_of(_text(place, value))
    if name in SOURCE_FIELDS:
        return _source(place, value)
    return _texts(place, value) if name in _LISTS or name in WORD_FIELDS else _text(place, value)


def _source(place: str, value: Any) -> Source:  # noqa: ANN401 - any TOML value
    if isinstance(value, dict):
        _refuse_others(place, value, ("column", "constant", "pattern"))
        return Source(**{key: _text(f"{place}.{key}", text) for key, text in value.items()})
    text = _text(place, value)
    return Source(constant=text[1:]) if text.startswith("=") else Source(column=text)


def _part(content: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    part: Mapping[str, Any] = _of_type(name, content.get(name, {}), dict, f"a section [{name}]")
    return part


def _texts(place: str, value: Any) -> tuple[str, ...]:  # noqa: ANN401 - any TOML value
    listed = [value] if isinstance(value, str) else _of_type(place, value, list, "a list of texts")
    return tuple(_text(place, entry) for entry in listed)


def _text(place: str, value: Any) -> str:  # noqa: ANN401 - any TOML value
    return str(_of_type(place, value, str, "a text"))


def _of_type(place: str, value: Any, kind: Any, expected: str) -> Any:  # noqa: ANN401 - any TOML value
    if not isinstance(value, kind):
        raise HrclogError(f"{place}: found {value!r}, expected {expected}")
    return value


def _refuse_others(place: str, part: Mapping[str, Any], known: Sequence[str]) -> None:
    others = [name for name in part if name not in known]
    if others:
        where = f" in [{place}]" if place else ""
        raise HrclogError(f"found the unknown name {others[0]!r}{where}, expected one of {', '.join(known)}")
