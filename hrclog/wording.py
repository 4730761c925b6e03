"""Numbers in sentences: a word has the form that its number asks for."""

from __future__ import annotations


def counted(number: int, singular: str, plural: str = "") -> str:
    """Say how many there are of something: "1 run", "12 runs".

    Args:
        number: how many.
        singular: what they are called, as one; a verb may follow, "run is".
        plural: what they are called otherwise; without one it is the singular and an "s".
    """
    return f"{number:,} {agree(number, singular, plural or f'{singular}s')}"


def share(number: int, total: int, singular: str, plural: str = "") -> str:
    """Say how many of how many there are: "1 of 1 run", "2 of 12 runs".

    Args:
        number: how many.
        total: of how many.
        singular: what they are called, as one.
        plural: what they are called otherwise; without one it is the singular and an "s".
    """
    return f"{number:,} of {counted(total, singular, plural)}"


def agree(number: int, singular: str, plural: str) -> str:
    """Choose the form of a word that stands apart from its number: "1 of 12 runs is", "2 of 12 runs are"."""
    return singular if number == 1 else plural
