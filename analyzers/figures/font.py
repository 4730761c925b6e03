"""A font that has the characters of a text: the embedded one if it can, else one of the system's."""

from __future__ import annotations

import unicodedata
from functools import lru_cache
from typing import Final

from PIL import ImageFont

Font = ImageFont.FreeTypeFont

# found by file name in the folders of the system; none is required
_WIDER: Final = (
    "DejaVuSans.ttf",
    "NotoSansCJK-Regular.ttc",
    "NotoSans-Regular.ttf",
    "wqy-microhei.ttc",
    "Arial Unicode.ttf",
    "msyh.ttc",
    "msgothic.ttc",
    "malgun.ttf",
    "arial.ttf",
)
_ABSENT: Final = "\U0010fffe"  # a noncharacter: what a font draws for it is what it draws for any it lacks


@lru_cache(maxsize=64)
def embedded(size: int) -> Font:
    """Return the font that Pillow carries: Latin letters, digits and a few signs."""
    font = ImageFont.load_default(size)
    if not isinstance(font, ImageFont.FreeTypeFont):  # Pillow without FreeType has a bitmap of one size only
        raise TypeError("Pillow was built without FreeType")
    return font


@lru_cache(maxsize=4096)
def readable(text: str, size: int) -> tuple[str, Font]:
    """Return the text and a font of `size` px that has all its characters; without one, accents are dropped."""
    if text.isascii() or _has(embedded(size), text):
        return text, embedded(size)
    wider = [font for font in (_system(name, size) for name in _WIDER) if font is not None]
    for font in wider:
        if _has(font, text):
            return text, font
    plain = unicodedata.normalize("NFKD", text)
    return "".join(char for char in plain if not unicodedata.combining(char)), (*wider, embedded(size))[0]


@lru_cache(maxsize=64)
def _system(name: str, size: int) -> Font | None:
    try:
        return ImageFont.truetype(name, size)
    except OSError:
        return None


def _has(font: Font, text: str) -> bool:
    absent = bytes(font.getmask(_ABSENT))
    return all(char.isspace() or bytes(font.getmask(char)) != absent for char in set(text))
