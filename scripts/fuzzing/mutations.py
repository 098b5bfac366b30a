"""Ways in which files are spoilt: by disks, by editors, by other programs, by people."""

from __future__ import annotations

import contextlib
import json
import math
import random
import re
import tomllib
from collections.abc import Callable, Iterator
from typing import Any

import tomli_w

Mutation = Callable[[random.Random, bytes], bytes]

_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
"""Numbers of every format that is text."""

_WORD = re.compile(rb"\"[^\"\n]{0,60}\"|[A-Za-z_][A-Za-z_0-9]*|-?\d+\.?\d*")
"""Words, numbers and strings."""

NUMBERS = (
    *(b"0", b"-1", b"1", b"-0.0", b"nan", b"NaN", b"inf", b"-Infinity", b"1e308", b"-1e308", b"1e-320", b"1e999"),
    *(b"9" * 30, b"9" * 5000, b"2147483648", b"-9223372036854775809", b"4294967295", b"0.5", b"1e6", b"360", b"0x10"),
)
"""What numbers are replaced by."""

VALUES = (
    *(
        b"true",
        b"false",
        b"null",
        b"None",
        b'""',
        b"[]",
        b"{}",
        b"[[]]",
        b'"x"',
        b"5",
        b"[5]",
        b'{"a": 1}',
        b"..",
        b'":"',
    ),
    *(b'"../../../escaped"', b'"/etc/passwd"', b'"a\\u0000b"', b'"' + 300 * b"n" + b'"', b"1979-05-27", b"[1, 2, 3]"),
    *(
        "Ä\u202e\u0000\U0001f984".encode(),
        b"%s%n{}",
        b"$(reboot)",
        b"{view}",
        b"{frame}",
        b"${HOME}",
        b"'",
        b'"',
        b"\\",
    ),
)
"""What words and values are replaced by."""


def bits(rng: random.Random, content: bytes) -> bytes:
    """A few bytes are others."""
    spoilt = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8, 64))):
        if spoilt:
            spoilt[rng.randrange(len(spoilt))] = rng.choice((0, 255, 10, 32, rng.randrange(256), rng.randrange(256)))
    return bytes(spoilt)


def cut(rng: random.Random, content: bytes) -> bytes:
    """The end is missing."""
    return content[: rng.randrange(len(content) + 1)]


def removed(rng: random.Random, content: bytes) -> bytes:
    """A piece is missing."""
    begin, end = _piece(rng, content)
    return content[:begin] + content[end:]


def repeated(rng: random.Random, content: bytes) -> bytes:
    """A piece is there many times."""
    begin, end = _piece(rng, content)
    return content[:end] + content[begin:end] * rng.choice((1, 1, 2, 50)) + content[end:]


def moved(rng: random.Random, content: bytes) -> bytes:
    """A piece is elsewhere."""
    begin, end = _piece(rng, content)
    rest = content[:begin] + content[end:]
    place = rng.randrange(len(rest) + 1)
    return rest[:place] + content[begin:end] + rest[place:]


def inserted(rng: random.Random, content: bytes) -> bytes:
    """Something foreign is in it."""
    place = rng.randrange(len(content) + 1)
    foreign = rng.choice(
        (rng.randbytes(rng.choice((1, 4, 100))), b"\0", b"\xff\xfe", b"\xef\xbb\xbf", rng.choice(VALUES))
    )
    return content[:place] + foreign + content[place:]


def brackets(rng: random.Random, content: bytes) -> bytes:
    """Deeply nested."""
    place = rng.randrange(len(content) + 1)
    sign = rng.choice((b"[", b"{", b"(", b"<a>", b'{"a":', b"- ", b"a."))
    return content[:place] + sign * rng.choice((3, 70, 5000, 100_000)) + content[place:]


def number(rng: random.Random, content: bytes) -> bytes:
    """A number is another one."""
    return _replaced(rng, content, _NUMBER, rng.choice((*NUMBERS, str(rng.randrange(-100, 10_000)).encode())))


def value(rng: random.Random, content: bytes) -> bytes:
    """A word, number or string is something else."""
    return _replaced(rng, content, _WORD, rng.choice((*VALUES, *NUMBERS)))


def swapped(rng: random.Random, content: bytes) -> bytes:
    """A word is another one of the file."""
    words = _WORD.findall(content[:200_000])
    return _replaced(rng, content, _WORD, rng.choice(words)) if words else content


def lines(rng: random.Random, content: bytes) -> bytes:
    """A line is missing, twice there, or elsewhere."""
    rows = content.splitlines(keepends=True)
    if len(rows) < 2:
        return content
    k, other = rng.randrange(len(rows)), rng.randrange(len(rows))
    row = rows[k]
    choice = rng.randrange(3)
    if choice < 2:
        del rows[k]
    if choice > 0:
        rows.insert(other, row)
    return b"".join(rows)


def replaced(rng: random.Random, content: bytes) -> bytes:
    """Something else altogether."""
    return rng.choice(
        (b"", b"\n", b"\0" * 100, rng.randbytes(200), b"\xff\xd8\xff", b"[" * 100_000, b"{}", b"[]", b"5")
    )


def another_type(rng: random.Random, content: bytes) -> bytes:
    """A value of a TOML or JSON file, or a whole section, is of another type, missing, renamed, or there twice."""
    if max(map(len, content.splitlines()), default=0) > _LONGEST_LINE:
        return value(rng, content)
    with contextlib.suppress(ValueError, RecursionError, TypeError, AttributeError, OverflowError):
        as_json = content.lstrip()[:1] in (b"{", b"[")
        tree = json.loads(content) if as_json else tomllib.loads(content.decode())
        places = list(_places(tree))
        if places:
            _change(rng, *rng.choice(places), OTHERS if as_json else OTHERS[:-1])
            return (json.dumps(tree) if as_json else tomli_w.dumps(tree)).encode()
    return value(rng, content)


_LONGEST_LINE = 10_000
"""With longer keys, Python's parser of TOML takes all memory."""

OTHERS: tuple[Any, ...] = (
    *(True, False, 0, 5, -1, 2**40, 10**400, 0.5, -0.0, 1e308, math.inf, -math.inf, math.nan),
    *("", "x", ":", "..", "../../../escaped", "/etc/passwd", "a\0b", 300 * "n", "os:system", "{view}", "1.5", "\n"),
    *([], [5], [[5]], [True], ["x"], ["x", "x"], [[], {}], [1.0, 2.0, 3.0], 5000 * [1], {}, {"a": 1}, {"": {}}),
    *([{"use": "x"}], {"use": 5}, {"use": ":"}, {"x": {"y": {"z": []}}}, {300 * "n": 1}, None),
)
"""What values of structured files are replaced by; the last one cannot be said in TOML."""


def _places(tree: Any) -> Iterator[tuple[Any, Any]]:
    """Every value below a root: what holds it, and its key or number."""
    pairs = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, below in pairs:
        yield tree, key
        yield from _places(below)


def _change(rng: random.Random, holder: Any, key: Any, others: tuple[Any, ...]) -> None:
    way = rng.choice(("replace", "replace", "replace", "wrap", "remove", "rename", "twice"))
    if way == "remove":
        del holder[key]
    elif way == "wrap":
        holder[key] = rng.choice(([holder[key]], {"a": holder[key]}))
    elif way == "rename" and isinstance(holder, dict):
        holder[rng.choice(("x", "", "use", "../x", "a\0b", key + "s", key[:-1]))] = holder.pop(key)
    elif way == "twice" and isinstance(holder, list):
        holder.insert(key, holder[key])
    else:
        holder[key] = rng.choice(others)


def whole_numbers(rng: random.Random, content: bytes) -> bytes:
    """Four bytes of a binary header are a large or negative number: sizes, counts, offsets."""
    spoilt = bytearray(content)
    for _ in range(rng.choice((1, 2))):
        if len(spoilt) >= 4:
            place = rng.randrange(min(len(spoilt) - 3, rng.choice((64, 1024, 10**9))))
            spoilt[place : place + 4] = rng.choice((b"\xff" * 4, b"\x00\x01\x86\xa0", b"\x7f\xff\xff\xff", b"\0" * 4))
    return bytes(spoilt)


TEXT: tuple[Mutation, ...] = (
    *(bits, cut, removed, repeated, moved, inserted, brackets, number, number, number, value, value, value, swapped),
    *(swapped, lines, lines, replaced, another_type, another_type, another_type, another_type, another_type),
)
BINARY: tuple[Mutation, ...] = (
    bits,
    bits,
    cut,
    removed,
    repeated,
    moved,
    inserted,
    whole_numbers,
    whole_numbers,
    replaced,
)


def mutated(rng: random.Random, content: bytes, ways: tuple[Mutation, ...]) -> bytes:
    """A file spoilt once, sometimes several times; never the same as before."""
    spoilt = content
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        spoilt = rng.choice(ways)(rng, spoilt)
    return spoilt if spoilt != content else content + b"\0"


def _piece(rng: random.Random, content: bytes) -> tuple[int, int]:
    begin = rng.randrange(len(content) + 1)
    return begin, min(len(content), begin + rng.choice((1, 2, 8, 40, 400)))


def _replaced(rng: random.Random, content: bytes, pattern: re.Pattern[bytes], by: bytes) -> bytes:
    # files of poses are long: a window is enough
    begin = rng.randrange(max(1, len(content) - 20_000))
    found = list(pattern.finditer(content, begin, begin + 20_000))
    if not found:
        return content
    match = rng.choice(found)
    return content[: match.start()] + by + content[match.end() :]
