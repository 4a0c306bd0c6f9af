"""Items of an ingest stream from arrays, as bytes. Lists of points never become Python objects.

The few single fields of a message are written by protobuf, the lists by `_rows`: bytes that follow each
other are one message. What only the server can judge (finite numbers, ranges, references) is left to it.
"""

from __future__ import annotations

import datetime
import math
from typing import Any

import numpy as np
import numpy.typing as npt
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp

from . import _poses, _rows
from .noise import kinect_sigma_m
from .v1 import (
    Camera,
    DescriptorKind,
    IngestRequest,
    KannalaBrandt,
    Keyframe,
    PinholeRadialTangential,
)

Ids = npt.NDArray[np.int64]
Time = float | np.datetime64 | datetime.datetime

_MEMBERS: list[Any] = list(IngestRequest.DESCRIPTOR.oneofs_by_name["item"].fields)
_FIELDS: dict[str, int] = {
    member.message_type.full_name: member.number
    for member in _MEMBERS
    if member.name not in ("open", "set_camera")
}
KEYFRAME = _FIELDS[Keyframe.DESCRIPTOR.full_name]
SET_CAMERA: int = IngestRequest.DESCRIPTOR.fields_by_name["set_camera"].number


def field_of(item: Message) -> int:
    """The number of the member of `IngestRequest.item` that takes this message."""
    number = _FIELDS.get(item.DESCRIPTOR.full_name)
    if number is None:
        raise TypeError(f"{item.DESCRIPTOR.full_name} is no item of an ingest stream")
    return number


def member_of(request: IngestRequest) -> tuple[int, Any]:
    """The number of the item that a request has, and the item."""
    name = request.WhichOneof("item")
    if name is None or name == "open":
        raise TypeError("an IngestRequest without an item")
    return IngestRequest.DESCRIPTOR.fields_by_name[name].number, getattr(request, name)


def head(sequence: int, field: int, size: int) -> bytes:
    """An `IngestRequest` up to its item of so many bytes."""
    start = _rows.tag(1, _rows.VARINT) + _rows.varint(sequence) + _rows.tag(field, _rows.LENGTH)
    return start + _rows.varint(size)


def request(sequence: int, field: int, item: bytes) -> bytes:
    """An `IngestRequest`."""
    return head(sequence, field, len(item)) + item


def timestamp(t: Time) -> Timestamp:
    """A time as Unix seconds, `datetime64` (UTC) or `datetime`."""
    if isinstance(t, np.datetime64):
        seconds, nanos = divmod(int(t.astype("datetime64[ns]").astype(np.int64)), 10**9)
        return Timestamp(seconds=seconds, nanos=nanos)
    if isinstance(t, datetime.datetime):
        since = t.astimezone(datetime.timezone.utc) - datetime.datetime(
            1970, 1, 1, tzinfo=datetime.timezone.utc
        )
        seconds = since.days * 86400 + since.seconds
        return Timestamp(seconds=seconds, nanos=since.microseconds * 1000)
    if not math.isfinite(t):
        raise ValueError(f"t must be a finite number of seconds, not {t}")
    seconds = math.floor(t)
    seconds, nanos = divmod(seconds * 10**9 + round((t - seconds) * 1e9), 10**9)
    return Timestamp(seconds=seconds, nanos=nanos)


def camera(
    id: int, width: int, height: int, K: npt.ArrayLike, distortion: npt.ArrayLike | None, model: str
) -> Camera:
    """A camera by its 3×3 matrix and OpenCV's coefficients."""
    k = _poses.shaped("K", K, 3, 3)
    if k[0, 1] != 0 or not np.array_equal(k[[1, 2, 2, 2], [0, 0, 1, 2]], [0, 0, 0, 1]):
        raise ValueError("K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]: skew is not supported")
    numbers = np.ravel(np.asarray(() if distortion is None else distortion, np.float64)).tolist()
    fx, fy, cx, cy = k[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
    out = Camera(id=id, width_px=width, height_px=height)
    if model == "fisheye":
        if len(numbers) not in (0, 4):
            raise ValueError(f"distortion of a fisheye has 4 coefficients, not {len(numbers)}")
        names: tuple[str, ...] = ("k1", "k2", "k3", "k4")
        intrinsics: Any = KannalaBrandt(fx=fx, fy=fy, cx=cx, cy=cy, **dict(zip(names, numbers)))
        out.kannala_brandt.CopyFrom(intrinsics)
    elif model == "pinhole":
        if len(numbers) not in (0, 4, 5):
            raise ValueError(
                f"distortion of a pinhole has 4 or 5 coefficients (k1, k2, p1, p2, k3), not {len(numbers)}"
            )
        names = ("k1", "k2", "p1", "p2", "k3")
        intrinsics = PinholeRadialTangential(fx=fx, fy=fy, cx=cx, cy=cy, **dict(zip(names, numbers)))
        out.pinhole_radial_tangential.CopyFrom(intrinsics)
    else:
        raise ValueError(f'model must be "pinhole" or "fisheye", not {model!r}')
    return out


def ids(name: str, value: npt.ArrayLike) -> Ids:
    """N ids, at least 0."""
    array = np.asarray(value)
    if array.ndim != 1 or (array.size and array.dtype.kind not in "iu"):
        raise ValueError(f"{name} must be N integers, not {array.dtype} of shape {array.shape}")
    array = array.astype(np.int64)
    if array.size and array.min() < 0:
        raise ValueError(f"{name} must be at least 0, not {array.min()}")
    return array


def measurements(
    pixels: npt.ArrayLike,
    depths: npt.ArrayLike | None,
    sigmas: npt.ArrayLike | None,
    sigma_px: npt.ArrayLike | None,
    first_field: int,
) -> _rows.Columns:
    """Pixel, sigma_px, depth_m and sigma_depth_m, in four fields that follow each other."""
    uv = _poses.shaped("pixels", pixels, None, 2)
    count = len(uv)
    columns = _rows.nested(first_field, _rows.doubles(1, uv))
    if sigma_px is not None:
        columns += _rows.doubles(first_field + 1, _per_row("sigma_px", sigma_px, count)[:, None])
    if depths is None:
        if sigmas is not None:
            raise ValueError("sigmas are those of depths, which are missing")
        return columns
    z = _poses.shaped("depths", depths, None)
    if len(z) != count:
        raise ValueError(f"depths must be one a pixel, {count}, not {len(z)}")
    is_measured = ~np.isnan(z) & (z != 0)
    sigma = kinect_sigma_m(z)
    if sigmas is not None:
        given = _per_row("sigmas", sigmas, count)
        sigma = np.where(np.isnan(given), sigma, given)
    both = np.column_stack([z, sigma])
    return columns + _rows.doubles(first_field + 2, both, is_measured)


def descriptor(
    field: int, values: npt.ArrayLike, count: int, name: str, kind: str | None
) -> _rows.Columns:
    """A descriptor a row: N×W bytes, or N×D floats."""
    array = np.asarray(values)
    if array.ndim != 2 or len(array) != count:
        raise ValueError(f"descriptors must be {count}×D, not of shape {array.shape}")
    if array.dtype == np.uint8:
        kind, data = kind or "binary", np.ascontiguousarray(array)
    elif array.dtype.kind == "f":
        kind, data = kind or "float32", np.ascontiguousarray(array, "<f4").view(np.uint8)
    else:
        raise ValueError(f"descriptors must be uint8 or floats, not {array.dtype}")
    if kind not in ("binary", "float32", "uint8") or (kind == "float32") != (array.dtype != np.uint8):
        raise ValueError(f"descriptor_kind {kind!r} does not fit descriptors of {array.dtype}")
    number = DescriptorKind.Value(f"DESCRIPTOR_KIND_{kind.upper()}")
    text = name.encode()
    head = _rows.tag(1, _rows.VARINT) + _rows.varint(number)
    head += _rows.tag(2, _rows.LENGTH) + _rows.varint(len(text)) + text
    return _rows.nested(field, [_rows.constant(count, head), *_rows.raw(3, data)])


def observations(
    field: int, landmarks: Ids, measured: _rows.Columns, described: _rows.Columns
) -> bytes:
    """A list of `Observation`, whose number in its message is `field`."""
    seen = _rows.nested(1, _rows.integers(2, landmarks))
    return _rows.join(_rows.nested(field, [*seen, *measured, *described]))


def landmarks(field: int, ids: Ids, points: npt.ArrayLike | None) -> bytes:
    """A list of `Landmark`; one whose point is NaN is left to the server's triangulation."""
    columns = _rows.integers(2, ids)
    if points is not None:
        xyz = np.asarray(points, np.float64)
        has_point = np.asarray(~np.isnan(xyz).any(axis=1))
        columns += _rows.nested(3, _rows.doubles(1, xyz), has_point)
    return _rows.join(_rows.nested(field, columns))


def _per_row(name: str, value: npt.ArrayLike, count: int) -> _poses.Array:
    """One number, or one a row."""
    array = np.asarray(value, np.float64)
    if array.shape not in ((), (count,)):
        raise ValueError(f"{name} must be one number or {count}, not of shape {array.shape}")
    return np.broadcast_to(array, count)
