from covis.v1 import geometry_pb2 as _geometry_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Camera(_message.Message):
    __slots__ = ("client_id", "id", "width_px", "height_px", "rolling_shutter_readout_ms", "pinhole_radial_tangential", "kannala_brandt", "snavely")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    WIDTH_PX_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_PX_FIELD_NUMBER: _ClassVar[int]
    ROLLING_SHUTTER_READOUT_MS_FIELD_NUMBER: _ClassVar[int]
    PINHOLE_RADIAL_TANGENTIAL_FIELD_NUMBER: _ClassVar[int]
    KANNALA_BRANDT_FIELD_NUMBER: _ClassVar[int]
    SNAVELY_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    width_px: int
    height_px: int
    rolling_shutter_readout_ms: float
    pinhole_radial_tangential: PinholeRadialTangential
    kannala_brandt: KannalaBrandt
    snavely: Snavely
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., width_px: _Optional[int] = ..., height_px: _Optional[int] = ..., rolling_shutter_readout_ms: _Optional[float] = ..., pinhole_radial_tangential: _Optional[_Union[PinholeRadialTangential, _Mapping]] = ..., kannala_brandt: _Optional[_Union[KannalaBrandt, _Mapping]] = ..., snavely: _Optional[_Union[Snavely, _Mapping]] = ...) -> None: ...

class PinholeRadialTangential(_message.Message):
    __slots__ = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    FX_FIELD_NUMBER: _ClassVar[int]
    FY_FIELD_NUMBER: _ClassVar[int]
    CX_FIELD_NUMBER: _ClassVar[int]
    CY_FIELD_NUMBER: _ClassVar[int]
    K1_FIELD_NUMBER: _ClassVar[int]
    K2_FIELD_NUMBER: _ClassVar[int]
    P1_FIELD_NUMBER: _ClassVar[int]
    P2_FIELD_NUMBER: _ClassVar[int]
    K3_FIELD_NUMBER: _ClassVar[int]
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    def __init__(self, fx: _Optional[float] = ..., fy: _Optional[float] = ..., cx: _Optional[float] = ..., cy: _Optional[float] = ..., k1: _Optional[float] = ..., k2: _Optional[float] = ..., p1: _Optional[float] = ..., p2: _Optional[float] = ..., k3: _Optional[float] = ...) -> None: ...

class KannalaBrandt(_message.Message):
    __slots__ = ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    FX_FIELD_NUMBER: _ClassVar[int]
    FY_FIELD_NUMBER: _ClassVar[int]
    CX_FIELD_NUMBER: _ClassVar[int]
    CY_FIELD_NUMBER: _ClassVar[int]
    K1_FIELD_NUMBER: _ClassVar[int]
    K2_FIELD_NUMBER: _ClassVar[int]
    K3_FIELD_NUMBER: _ClassVar[int]
    K4_FIELD_NUMBER: _ClassVar[int]
    fx: float
    fy: float
    cx: float
    cy: float
    k1: float
    k2: float
    k3: float
    k4: float
    def __init__(self, fx: _Optional[float] = ..., fy: _Optional[float] = ..., cx: _Optional[float] = ..., cy: _Optional[float] = ..., k1: _Optional[float] = ..., k2: _Optional[float] = ..., k3: _Optional[float] = ..., k4: _Optional[float] = ...) -> None: ...

class Snavely(_message.Message):
    __slots__ = ("focal", "k1", "k2")
    FOCAL_FIELD_NUMBER: _ClassVar[int]
    K1_FIELD_NUMBER: _ClassVar[int]
    K2_FIELD_NUMBER: _ClassVar[int]
    focal: float
    k1: float
    k2: float
    def __init__(self, focal: _Optional[float] = ..., k1: _Optional[float] = ..., k2: _Optional[float] = ...) -> None: ...

class Rig(_message.Message):
    __slots__ = ("client_id", "id", "cameras")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    CAMERAS_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    cameras: _containers.RepeatedCompositeFieldContainer[RigCamera]
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., cameras: _Optional[_Iterable[_Union[RigCamera, _Mapping]]] = ...) -> None: ...

class RigCamera(_message.Message):
    __slots__ = ("camera_id", "rig_from_camera")
    CAMERA_ID_FIELD_NUMBER: _ClassVar[int]
    RIG_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    camera_id: int
    rig_from_camera: _geometry_pb2.RigidTransform
    def __init__(self, camera_id: _Optional[int] = ..., rig_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ...) -> None: ...
