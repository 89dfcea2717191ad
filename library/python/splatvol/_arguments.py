"""Arguments of calls: errors in words of our own."""

from __future__ import annotations

import difflib
import operator
from typing import Any, Iterable, Tuple


def as_size(size: Any) -> Tuple[int, int]:
    """Returns width and height of a picture."""
    try:
        width, height = size
        return operator.index(width), operator.index(height)
    except (TypeError, ValueError):
        raise TypeError(f"size={size!r}: take the width and the height in pixels, such as size=(800, 600)") from None


def as_whole(name: str, number: Any) -> int:
    try:
        return operator.index(number)
    except TypeError:
        raise TypeError(f"{name}={number!r}: take a whole number") from None


def as_number(name: str, number: Any) -> float:
    try:
        return float(number)
    except (TypeError, ValueError):
        raise TypeError(f"{name}={number!r}: take a number") from None


def refuse_unknown(call: str, given: Iterable[str], known: Iterable[str]) -> None:
    """Raises a ``TypeError`` for the first option that a call does not have; it names the nearest that it has."""
    known = sorted(known)
    for name in given:
        if name in known:
            continue
        nearest = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean {nearest[0]}?" if nearest else f"it has {', '.join(known)}"
        raise TypeError(f"{call} has no option {name!r}: {hint}")
