"""What a process must renew of what it got by a fork: a lock that another thread held then is never released in it."""

from __future__ import annotations

import os
from typing import Final, Protocol
from weakref import WeakSet


class Renewable(Protocol):
    """Something that holds a lock."""

    def renew_after_fork(self) -> None:
        """Make the lock anew, in a process that has just been forked."""
        ...


_RENEWED: Final[WeakSet[Renewable]] = WeakSet()


def renew_after_fork(holder: Renewable) -> None:
    """Have something renewed in every process that is forked from this one, as long as it lives."""
    _RENEWED.add(holder)


def _renew_all() -> None:
    for holder in list(_RENEWED):
        holder.renew_after_fork()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
