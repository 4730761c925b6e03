"""What a definition of a message type costs: its text before it is parsed, and what it says before code is made of it.

The parser needs up to a millisecond per statement, and time that multiplies with each pair of parentheses within an
expression of IDL; the code that decodes holds a line per text or message in an array of fixed length.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

from hrclog.log.limits import DEFINITION, ELEMENTS, STATEMENTS, UNROLLED, Budget

if TYPE_CHECKING:
    from rosbags.interfaces.typing import FieldDesc, Typesdict

_ANY: Final = Budget(0)  # these limits do not grow with a file
_SKIPPED: Final = re.compile(r"[^\S\n]*(?:#[^\n]*)?\n")  # a line without a statement
_IDL_NOISE: Final = re.compile(r'"(?:[^"\\\n]|\\.)*"|//[^\n]*|/\*(?:[^*]|\*(?!/))*+\*/')
_ANNOTATION: Final = re.compile(r"@\s*\w+\s*\([^()]*\)")
_IDL_STATEMENT: Final = re.compile(r"[;@,]")
_OF_A_VALUE: Final = 3  # statements that take as long

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4  # kinds of types, as rosbags numbers them
_DEEPEST: Final = 50


def check_length(n_characters: int) -> None:
    """Raise if a definition is too long to be looked at.

    Raises:
        LimitError: it is.
    """
    _ANY.check(DEFINITION, n_characters)


def without_comments(text: str) -> str:
    """Return a definition of the language `ros2msg` without the lines that state nothing."""
    lines = f"{text}\n".splitlines(keepends=True)
    return "".join(line for line in lines if not _SKIPPED.fullmatch(line))


def checked_text(text: str) -> str:
    """Return a definition of the language `ros2msg` that may be parsed.

    Raises:
        LimitError: it is too long.
    """
    check_length(len(text))
    text = without_comments(text)
    _ANY.check(STATEMENTS, text.count("\n") + text.count(","))  # commas part the elements of a default
    return text


def checked_idl(text: str) -> str:
    """Return a definition of the language `ros2idl` that may be parsed; texts in it are empty, as decoding needs none.

    Raises:
        LimitError: it is too long.
        ValueError: it computes constants in a way that may take forever.
    """
    check_length(len(text))
    text = _IDL_NOISE.sub(lambda match: '""' if match[0].startswith('"') else " ", text)
    text = re.sub(r'""(?:\s*"")++', '""', text)
    _ANY.check(STATEMENTS, len(_IDL_STATEMENT.findall(text)) + _OF_A_VALUE * text.count("="))
    rest = _ANNOTATION.sub("", text)
    if "(" in rest or "<<" in rest:
        raise ValueError("it computes a constant with parentheses or a shift, expected a number")
    return text


def check_types(types: Typesdict) -> None:
    """Raise if decoders of these types would be too large, or could read for ever.

    Args:
        types: as rosbags parses them; types that are not among them are standard ones, and small.

    Raises:
        LimitError: arrays of fixed length are too long, alone or within each other.
        ValueError: types lie too deep within each other, or a list holds messages without content.
    """
    unrolled = 0
    sizes: dict[str, int] = {}
    for name, (_, fields) in types.items():
        for _, description in fields:
            inner, count, is_list = _parts(description)
            if is_list and int(inner[0]) == _NAME and types.get(str(inner[1]), ("", [""]))[1] == []:
                raise ValueError(f"{name} has a list of {inner[1]}, which holds nothing")
            unrolled += 0 if _is_number(inner) or count == 1 else count
        _ANY.check(UNROLLED, unrolled)
        _ANY.check(ELEMENTS, _size(name, types, sizes, 0))


def _parts(description: FieldDesc) -> tuple[Any, int, bool]:
    """Return the type of a field's elements, how many there are of fixed length, and whether they are a list."""
    kind: int = description[0]
    if kind not in (_ARRAY, _SEQUENCE):
        return description, 1, False
    content: Any = description[1]
    return (content[0], content[1], False) if kind == _ARRAY else (content[0], 0, True)


def _is_number(inner: Any) -> bool:  # noqa: ANN401 - rosbags describes types by nested tuples
    return bool(inner[0] == _BASE and inner[1][0] not in ("string", "wstring"))


def _size(name: str, types: Typesdict, sizes: dict[str, int], depth: int) -> int:
    """Return how many numbers and texts of fixed length a message of a type holds."""
    if name not in types:
        return 1
    if depth > _DEEPEST:
        raise ValueError(f"its types lie more than {_DEEPEST} deep within each other, or hold themselves")
    if name not in sizes:
        total = 0
        for _, description in types[name][1]:
            inner, count, _ = _parts(description)
            total += count * (_size(str(inner[1]), types, sizes, depth + 1) if inner[0] == _NAME else 1)
        sizes[name] = total
    return sizes[name]
