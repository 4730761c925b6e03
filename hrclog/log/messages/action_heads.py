"""The heads of an action's messages: their layout does not depend on the action, so they need no definition.

Recorders up to Jazzy store none for action topics. Goals, results and feedback themselves cannot be told then, ids and
states can.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final

from hrclog.wording import counted

_ID: Final = struct.Struct("16s")
_ENCAPSULATION: Final = 4  # bytes; alignment counts from behind them
_INFO: Final = struct.Struct("B3xiI16s4xq")  # kind of event, stamp, client, number
_COUNT: Final = struct.Struct("I")
_LITTLE: Final = 1


def _feedback(raw: bytes, order: str) -> dict[str, Any]:  # noqa: ARG001 - bytes have no order
    return {"goal_id": _ID.unpack_from(raw, _ENCAPSULATION)[0]}


def _event(raw: bytes, order: str, answer: str) -> dict[str, Any]:
    """Return what is known of a service event: the id of a request, and `answer`, a byte, of a response."""
    kind, seconds, rest, client, number = struct.unpack_from(order + _INFO.format, raw, _ENCAPSULATION)
    at = _ENCAPSULATION + _INFO.size
    (n_requests,) = struct.unpack_from(order + _COUNT.format, raw, at)
    at += _COUNT.size
    requests, responses = list[dict[str, Any]](), list[dict[str, Any]]()
    if n_requests:
        requests.append({"goal_id": _ID.unpack_from(raw, at)[0]})
    elif struct.unpack_from(order + _COUNT.format, raw, at)[0]:
        responses.append({answer: raw[at + _COUNT.size]})
    stamp = {"sec": seconds, "nanosec": rest}
    info = {"event_type": kind, "stamp": stamp, "client_gid": client, "sequence_number": number}
    return {"info": info, "request": requests, "response": responses}


_HEADS: Final[dict[str, Callable[[bytes, str], dict[str, Any]]]] = {
    "_FeedbackMessage": _feedback,
    "_SendGoal_Event": lambda raw, order: _event(raw, order, "accepted"),
    "_GetResult_Event": lambda raw, order: _event(raw, order, "status"),
}


def head_decoder(name: str) -> Callable[[bytes], Any] | None:
    """Return a decoder of the head of an action's messages as CDR, by the name of their type; None for other types."""
    decode = next((decode for ending, decode in _HEADS.items() if name.endswith(ending)), None)
    if decode is None:
        return None

    def decode_head(raw: bytes) -> dict[str, Any]:
        try:
            return decode(raw, "<" if raw[1] == _LITTLE else ">")
        except (struct.error, IndexError) as error:
            raise ValueError(f"found {counted(len(raw), 'byte')}, too few for the head of {name}") from error

    return decode_head
