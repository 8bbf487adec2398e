"""Documents: Python values ⇄ MongoDB's Extended JSON (version 2).

=====================================  ==================
Python                                 Extended JSON
=====================================  ==================
``datetime`` (naive: UTC)              ``{"$date": …}``
:class:`ObjectId`                      ``{"$oid": …}``
``bytes``                              ``{"$binary": …}``
``float('nan')``, ``±inf``             ``{"$numberDouble": …}``
``int`` beyond 32 bits                 ``{"$numberLong": …}``
=====================================  ==================

Whatever else Extended JSON has (decimals, regular expressions, timestamps) stays a dictionary as it is, and is written as it
was read.
"""

from __future__ import annotations

import base64
import json
import math
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any, Callable, Mapping, Sequence

Document = Mapping[str, Any]

_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True, order=True)
class ObjectId:
    """The id that a document gets where it has none: 24 hexadecimal digits."""

    hex: str

    def __post_init__(self) -> None:
        if len(self.hex) != 24 or not all(digit in "0123456789abcdefABCDEF" for digit in self.hex):
            raise ValueError(f"an ObjectId has 24 hexadecimal digits, not {self.hex!r}")
        object.__setattr__(self, "hex", self.hex.lower())

    def __str__(self) -> str:
        return self.hex


def encode(value: Any) -> str:
    """Returns a value as Extended JSON text.

    Raises:
        TypeError: the value is of a type that no document can hold.
        OverflowError: an integer has more than 64 bits.
    """
    return json.dumps(_to_json(value), ensure_ascii=False, allow_nan=False)


def decode(text: str) -> Any:
    """Returns the value of Extended JSON text."""
    return json.loads(text, object_hook=_from_object)


def _to_json(value: Any) -> Any:
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, int):
        return _integer(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else {"$numberDouble": _special(value)}
    if isinstance(value, datetime):
        return {"$date": {"$numberLong": str(_milliseconds(value))}}
    if isinstance(value, ObjectId):
        return {"$oid": value.hex}
    if isinstance(value, (bytes, bytearray)):
        return {"$binary": {"base64": base64.b64encode(value).decode("ascii"), "subType": "00"}}
    if isinstance(value, Mapping):
        return {_key(key): _to_json(item) for key, item in value.items()}
    if isinstance(value, Sequence):
        return [_to_json(item) for item in value]
    raise TypeError(f"a document cannot hold a {type(value).__name__}: {value!r}")


def _key(key: Any) -> str:
    if not isinstance(key, str):
        raise TypeError(f"keys of documents are strings, not {type(key).__name__}: {key!r}")
    return key


def _integer(value: int) -> Any:
    if -(2**31) <= value < 2**31:
        return value
    if -(2**63) <= value < 2**63:
        return {"$numberLong": str(value)}
    raise OverflowError(f"integers of documents have at most 64 bits: {value}")


def _special(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    return "Infinity" if value > 0 else "-Infinity"


def _milliseconds(value: datetime) -> int:
    aware = value if value.tzinfo else value.replace(tzinfo=timezone.utc)
    return (aware - _EPOCH) // timedelta(milliseconds=1)


def _from_object(value: dict[str, Any]) -> Any:
    if len(value) != 1:
        return value
    (key, content), = value.items()
    reader = _READERS.get(key)
    if reader is None:
        return value
    try:
        return reader(content)
    except (ValueError, TypeError, KeyError, OverflowError, AttributeError):
        return value  # a date beyond Python's years, or another form of the same type


def _date(content: Any) -> datetime:
    if isinstance(content, str):
        return datetime.fromisoformat(content.replace("Z", "+00:00"))
    return _EPOCH + timedelta(milliseconds=int(content))


def _binary(content: Any) -> bytes:
    if content["subType"] not in ("00", "0"):
        raise ValueError("not generic binary data")
    return base64.b64decode(content["base64"], validate=True)


_READERS: dict[str, Callable[[Any], Any]] = {
    "$oid": ObjectId,
    "$date": _date,
    "$binary": _binary,
    "$numberLong": int,
    "$numberInt": int,
    "$numberDouble": float,
}
