"""Protobuf's wire format for many messages of one kind at once, by numpy.

A message of a list has the same fields in each row, but varints and absent fields make rows of unequal
length. A column is therefore a matrix of bytes with a mask of those that count; all columns beside each
other, read row by row where the mask is set, are the bytes of the list. Numbers that are 0 are written
too, where protobuf leaves them out; both read the same. This file knows no message of covis.

https://protobuf.dev/programming-guides/encoding/
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Mask = npt.NDArray[np.bool_]
Floats = npt.NDArray[np.float64]

VARINT, FIXED64, LENGTH = 0, 1, 2


@dataclass(frozen=True)
class Column:
    """N×W bytes, and which of them count (`None`: all)."""

    data: Bytes
    keep: Mask | None = None

    def lengths(self) -> npt.NDArray[np.int64]:
        """Bytes of each row."""
        if self.keep is None:
            return np.full(len(self.data), self.data.shape[1], np.int64)
        return self.keep.sum(axis=1)


Columns = list[Column]


def varint(value: int) -> bytes:
    """One varint."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def tag(field: int, wire_type: int) -> bytes:
    """The key of a field."""
    return varint(field << 3 | wire_type)


def constant(count: int, raw: bytes) -> Column:
    """The same bytes in each row."""
    return Column(np.broadcast_to(np.frombuffer(raw, np.uint8), (count, len(raw))))


def varints(values: npt.NDArray[np.int64]) -> Column:
    """A varint a row; values at least 0."""
    width = max(1, (int(values.max(initial=0)).bit_length() + 6) // 7)
    places = np.arange(width)
    rest = values[:, None] >> (7 * places)
    data = (rest & 0x7F).astype(np.uint8)
    if width == 1:
        return Column(data)
    lengths = 1 + (rest[:, 1:] > 0).sum(axis=1, keepdims=True)
    data[places < lengths - 1] |= 0x80
    keep: Mask = places < lengths
    return Column(data, None if keep.all() else keep)


def integers(field: int, values: npt.NDArray[np.int64]) -> Columns:
    """An integer field, also where it is 0."""
    return [constant(len(values), tag(field, VARINT)), varints(values)]


def doubles(field: int, values: Floats, present: Mask | None = None) -> Columns:
    """Double fields `field`, `field + 1`, …, one for each column of N×K `values`; or none in a row."""
    count, fields = values.shape
    data = np.empty((count, fields, 9), np.uint8)
    data[:, :, 0] = [field + k << 3 | FIXED64 for k in range(fields)]
    data[:, :, 1:] = np.ascontiguousarray(values, "<f8").view(np.uint8).reshape(count, fields, 8)
    flat = data.reshape(count, 9 * fields)
    if present is None or present.all():
        return [Column(flat)]
    return [Column(flat, np.broadcast_to(present[:, None], flat.shape))]


def packed_doubles(field: int, values: Floats) -> Columns:
    """A packed list of doubles a row, N×K."""
    data = np.ascontiguousarray(values, "<f8").view(np.uint8).reshape(len(values), -1)
    head = tag(field, LENGTH) + varint(data.shape[1])
    return [constant(len(values), head), Column(data)]


def raw(field: int, data: Bytes) -> Columns:
    """A bytes field of one length, N×W."""
    return [constant(len(data), tag(field, LENGTH) + varint(data.shape[1])), Column(data)]


def nested(field: int, parts: Columns, present: Mask | None = None) -> Columns:
    """A message field with these fields; absent in the rows that `present` leaves out."""
    count = len(parts[0].data)
    if all(part.keep is None for part in parts):
        size = sum(part.data.shape[1] for part in parts)
        columns = [constant(count, tag(field, LENGTH) + varint(size)), *parts]
    else:
        size_of_each = sum(part.lengths() for part in parts)
        head = constant(count, tag(field, LENGTH))
        columns = [head, varints(np.asarray(size_of_each, np.int64)), *parts]
    if present is None or present.all():
        return columns
    return [masked(column, present) for column in columns]


def masked(column: Column, present: Mask) -> Column:
    """The column without the rows that `present` leaves out."""
    shape = column.data.shape
    keep = np.broadcast_to(present[:, None], shape)
    return Column(column.data, keep if column.keep is None else keep & column.keep)


def join(parts: Sequence[Column]) -> bytes:
    """The bytes of all rows, one after the other."""
    if not len(parts[0].data):
        return b""
    data = np.concatenate([part.data for part in parts], axis=1)
    if all(part.keep is None for part in parts):
        return data.tobytes()
    every = [
        np.ones(part.data.shape, np.bool_) if part.keep is None else part.keep for part in parts
    ]
    return data[np.concatenate(every, axis=1)].tobytes()
