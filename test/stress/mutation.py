# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutates messages and files. rng: a random.Random; the same seed gives the same mutations."""
import math
import re

import genpy

INTEGERS = (0, 1, -1, 2, 7, 160, 255, 256, 4095, 65535, 65536, 2 ** 31 - 1, 2 ** 31, 2 ** 32 - 1, -2 ** 31)
FLOATS = (0.0, -0.0, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e-200, 1e200, 5e-324, 1.7e308, 0.5, 1e9)
TEXTS = ("", "16UC1", "32FC1", "bgr8", "rgb8", "mono8", "32SC1", "mono16", "bayer_rggb8", "8UC0", "64FC4", "x" * 5000,
         "plumb_bob", "rational_polynomial", "equidistant", "/", "dslr_optical_frame", "\u00e4\u4e16")
RANGES = {"int8": (-2 ** 7, 2 ** 7 - 1), "uint8": (0, 2 ** 8 - 1), "int16": (-2 ** 15, 2 ** 15 - 1),
          "uint16": (0, 2 ** 16 - 1), "int32": (-2 ** 31, 2 ** 31 - 1), "uint32": (0, 2 ** 32 - 1),
          "int64": (-2 ** 63, 2 ** 63 - 1), "uint64": (0, 2 ** 64 - 1)}


def mutate_message(message, rng):
    """Changes one to three fields of a message in place, however deep they lie."""
    for _ in range(rng.randint(1, 3)):
        _mutate(message, rng)


def _mutate(message, rng):
    index = rng.randrange(len(message.__slots__))
    name, kind = message.__slots__[index], message._slot_types[index]
    setattr(message, name, _mutated(getattr(message, name), kind, rng))


def _mutated(value, kind, rng):
    if isinstance(value, genpy.Message):
        _mutate(value, rng)
        return value
    if kind in ("time", "duration"):
        seconds = (0, 1, value.secs, max(0, value.secs + rng.randint(-100, 100)), 2 ** 31 - 1, 2 ** 32 - 1)
        return type(value)(rng.choice(seconds if kind == "time" else (0, value.secs)), rng.choice((0, 1, 950000000, 999999999)))
    if kind == "bool":
        return not value
    if kind == "string":
        return rng.choice(TEXTS)
    if kind in ("float32", "float64"):
        return rng.choice(FLOATS)
    if kind in RANGES:
        low, high = RANGES[kind]
        return min(max(rng.choice(INTEGERS + (value + 1, value - 1, rng.randint(low, high))), low), high)
    return _mutated_array(value, kind, rng)


def _mutated_array(value, kind, rng):
    base, length = re.match(r"(.*)\[(\d*)\]$", kind).groups()
    fixed, what = bool(length), rng.choice(("cut", "grow", "empty", "change", "change"))
    if isinstance(value, bytes):
        data = bytearray(value)
        if what == "change":
            for _ in range(min(len(data), rng.choice((1, 10, 1000)))):
                data[rng.randrange(len(data))] = rng.randrange(256)
        elif not fixed:
            data = {"cut": data[:rng.randrange(len(data) + 1)], "grow": data + bytes(rng.randint(1, 5000)),
                    "empty": bytearray()}[what]
        return bytes(data)
    items = list(value)
    if what == "change" or fixed:
        for _ in range(min(len(items), rng.choice((1, 2, 9)))):
            at = rng.randrange(len(items))
            items[at] = _mutated(items[at], base, rng)
        return items
    return {"cut": items[:rng.randrange(len(items) + 1)], "grow": items + items[:1] * rng.randint(1, 50),
            "empty": []}[what]


def mutate_bytes(data, rng):
    """Other content of a file."""
    data = bytearray(data)
    for _ in range(rng.randint(1, 3)):
        what = rng.choice(("bits", "cut", "zero", "insert", "delete", "double", "empty", "number"))
        at, length = rng.randrange(len(data) + 1), rng.choice((1, 4, 64, 4096))
        if what == "bits":
            for _ in range(rng.choice((1, 8, 64))):
                if data:
                    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        elif what == "cut":
            del data[at:]
        elif what == "zero":
            data[at:at + length] = bytes(len(data[at:at + length]))
        elif what == "insert":
            data[at:at] = bytes(rng.randrange(256) for _ in range(min(length, 64)))
        elif what == "delete":
            del data[at:at + length]
        elif what == "double":
            data[at:at] = data[at:at + length]
        elif what == "empty":
            data = bytearray()
        else:
            data = _other_number(data, rng)
    return bytes(data)


def _other_number(data, rng):
    """A text with one of its numbers, or of its words, replaced."""
    found = list(re.finditer(rb"-?\d+(\.\d+)?|\w+", bytes(data[:20000])))
    if not found:
        return data
    match = rng.choice(found)
    new = rng.choice([str(value) for value in INTEGERS + FLOATS] + ["", "text", "[]", "{}", "null", ".nan", ".inf", "~"])
    return data[:match.start()] + new.encode() + data[match.end():]
