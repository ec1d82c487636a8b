# SPDX-License-Identifier: MIT
"""Mutations of JSON that stays JSON: values of other types, missing and repeated keys, depth, long lists."""

from __future__ import annotations

import json
from random import Random
from typing import Any

_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 255, 10**6, 2**31, 2**32, 2**53, 2**63, -(2**63), 10**400, 0.5, -0.0),
    *(1e-320, 1e9, 1e38, 1e39, 1e308, float("nan"), float("inf"), -float("inf"), "", "0", "nan", "x", "<b>"),
    *(
        "../secret.png",
        "/etc/hostname",
        "data:,",
        "data:application/octet-stream;base64,AAAA",
        "\ud800",
        "\0",
    ),
    *("a" * 10000, [], {}, [[]], [None], [0], [0, 0, 0], [1e308] * 3, ["a"], {"a": 1}),
    [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
)
_MOST = 1 << 20  # characters; what is larger takes long and shows no more


def mutate_json(value: Any, rng: Random) -> Any:
    """Return a JSON value after one mutation; `value` itself is changed."""
    places = list(_places(value))
    if not places:
        return rng.choice(_VALUES)
    holder, key = rng.choice(places)
    kind = rng.random()
    if kind < 0.5:
        holder[key] = _other(holder[key], rng)
    elif kind < 0.65:
        del holder[key]
    elif kind < 0.75:
        holder[key] = _copied(rng.choice(places), rng)
    elif kind < 0.85 and isinstance(holder, list):
        holder.extend([holder[key]] * rng.choice((1, 2, 50)))
    elif kind < 0.9:
        holder[key] = _deep(holder[key], rng)
    elif isinstance(holder, dict):
        holder[rng.choice(("x", "", "__proto__", str(key) + "2", "extensions", "sparse"))] = holder[key]
    else:
        rng.shuffle(holder)
    return value


def _places(value: Any, depth: int = 0) -> Any:
    """Every (holder, key), outermost first."""
    if depth > 30:
        return
    keys: Any = value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in list(keys):
        yield value, key
        yield from _places(value[key], depth + 1)


def _other(old: Any, rng: Random) -> Any:
    """A value of another kind, or a number near to the old one or far from it."""
    is_number = isinstance(old, int | float) and not isinstance(old, bool)
    if is_number and abs(old) < 1e300 and rng.random() < 0.5:
        return rng.choice((old + 1, old - 1, -old, old * 2, old * 1000, old / 3, str(old), [old]))
    return rng.choice(_VALUES)


def _copied(place: tuple[Any, Any], rng: Random) -> Any:
    """What stands at another place, so that things have each other's types."""
    text = json.dumps(place[0][place[1]])
    return json.loads(text) if len(text) < _MOST else rng.choice(_VALUES)


def _deep(value: Any, rng: Random) -> Any:
    """A value within many lists or objects."""
    as_lists = rng.random() < 0.5
    for _ in range(rng.choice((2, 10, 100, 400))):
        value = [value] if as_lists else {"children": value}
    return value


def json_bytes(value: Any, rng: Random) -> bytes:
    """Return JSON text, sometimes with a key twice, or nested deeper than a parser may follow."""
    text = json.dumps(value, ensure_ascii=True)
    kind = rng.random()
    if kind < 0.05 and text.startswith("{"):
        key = rng.choice(list(value) or ["a"])
        text = "{" + json.dumps(key) + ": " + json.dumps(rng.choice(_VALUES)) + ", " + text[1:]
    elif kind < 0.07:
        n = rng.choice((900, 5000, 100_000))
        text = '{"a":' * n + text + "}" * n
    return text.encode("utf-8", errors="surrogatepass")


def mutate_json_text(data: bytes, rng: Random) -> bytes:
    """Return a JSON text after one mutation; bytes that are no JSON are left to others."""
    try:
        value = json.loads(data)
    except (ValueError, RecursionError):
        return data
    try:
        return json_bytes(mutate_json(value, rng), rng)[: 4 * _MOST]
    except RecursionError:
        return data


def mutate_json_within(data: bytes, rng: Random, *, same_length: bool = False) -> bytes:
    """Mutate the first JSON object that stands within other bytes; keep its length by blanks if asked to."""
    start = data.find(b'{"')
    if start < 0:
        return data
    text = data[start:].decode("utf-8", errors="replace")
    try:
        value, end = json.JSONDecoder().raw_decode(text)
    except (ValueError, RecursionError):
        return data
    n_bytes = len(text[:end].encode())
    try:
        changed = mutate_json(value, rng)
        new = json.dumps(changed, separators=(",", ":")).encode() if same_length else json_bytes(changed, rng)
    except RecursionError:
        return data
    if same_length:
        if len(new) > n_bytes:
            return data
        new = new.ljust(n_bytes)
    return data[:start] + new + data[start + n_bytes :]
