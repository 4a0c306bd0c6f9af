from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Vector2(_message.Message):
    __slots__ = ("x", "y")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ...) -> None: ...

class Vector3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class GeodeticPosition(_message.Message):
    __slots__ = ("latitude_deg", "longitude_deg", "height_m")
    LATITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    LONGITUDE_DEG_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    latitude_deg: float
    longitude_deg: float
    height_m: float
    def __init__(self, latitude_deg: _Optional[float] = ..., longitude_deg: _Optional[float] = ..., height_m: _Optional[float] = ...) -> None: ...

class Quaternion(_message.Message):
    __slots__ = ("x", "y", "z", "w")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    W_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    w: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ..., w: _Optional[float] = ...) -> None: ...

class RigidTransform(_message.Message):
    __slots__ = ("translation", "rotation")
    TRANSLATION_FIELD_NUMBER: _ClassVar[int]
    ROTATION_FIELD_NUMBER: _ClassVar[int]
    translation: Vector3
    rotation: Quaternion
    def __init__(self, translation: _Optional[_Union[Vector3, _Mapping]] = ..., rotation: _Optional[_Union[Quaternion, _Mapping]] = ...) -> None: ...

class RigidTransform2(_message.Message):
    __slots__ = ("translation", "angle_rad")
    TRANSLATION_FIELD_NUMBER: _ClassVar[int]
    ANGLE_RAD_FIELD_NUMBER: _ClassVar[int]
    translation: Vector2
    angle_rad: float
    def __init__(self, translation: _Optional[_Union[Vector2, _Mapping]] = ..., angle_rad: _Optional[float] = ...) -> None: ...

class InformationMatrix3(_message.Message):
    __slots__ = ("upper_triangle",)
    UPPER_TRIANGLE_FIELD_NUMBER: _ClassVar[int]
    upper_triangle: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, upper_triangle: _Optional[_Iterable[float]] = ...) -> None: ...

class InformationMatrix6(_message.Message):
    __slots__ = ("upper_triangle",)
    UPPER_TRIANGLE_FIELD_NUMBER: _ClassVar[int]
    upper_triangle: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, upper_triangle: _Optional[_Iterable[float]] = ...) -> None: ...

class Covariance3(_message.Message):
    __slots__ = ("upper_triangle",)
    UPPER_TRIANGLE_FIELD_NUMBER: _ClassVar[int]
    upper_triangle: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, upper_triangle: _Optional[_Iterable[float]] = ...) -> None: ...

class Covariance6(_message.Message):
    __slots__ = ("upper_triangle",)
    UPPER_TRIANGLE_FIELD_NUMBER: _ClassVar[int]
    upper_triangle: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, upper_triangle: _Optional[_Iterable[float]] = ...) -> None: ...

class Bounds3(_message.Message):
    __slots__ = ("min", "max")
    MIN_FIELD_NUMBER: _ClassVar[int]
    MAX_FIELD_NUMBER: _ClassVar[int]
    min: Vector3
    max: Vector3
    def __init__(self, min: _Optional[_Union[Vector3, _Mapping]] = ..., max: _Optional[_Union[Vector3, _Mapping]] = ...) -> None: ...
