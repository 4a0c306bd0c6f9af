from covis.v1 import geometry_pb2 as _geometry_pb2
from covis.v1 import map_pb2 as _map_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ConstraintKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    CONSTRAINT_KIND_UNSPECIFIED: _ClassVar[ConstraintKind]
    CONSTRAINT_KIND_ODOMETRY: _ClassVar[ConstraintKind]
    CONSTRAINT_KIND_LOOP_CLOSURE: _ClassVar[ConstraintKind]
    CONSTRAINT_KIND_OTHER: _ClassVar[ConstraintKind]
    CONSTRAINT_KIND_MARGINAL: _ClassVar[ConstraintKind]
CONSTRAINT_KIND_UNSPECIFIED: ConstraintKind
CONSTRAINT_KIND_ODOMETRY: ConstraintKind
CONSTRAINT_KIND_LOOP_CLOSURE: ConstraintKind
CONSTRAINT_KIND_OTHER: ConstraintKind
CONSTRAINT_KIND_MARGINAL: ConstraintKind

class Constraint(_message.Message):
    __slots__ = ("relative_pose", "position_prior", "pose_prior")
    RELATIVE_POSE_FIELD_NUMBER: _ClassVar[int]
    POSITION_PRIOR_FIELD_NUMBER: _ClassVar[int]
    POSE_PRIOR_FIELD_NUMBER: _ClassVar[int]
    relative_pose: RelativePoseConstraint
    position_prior: PositionPrior
    pose_prior: PosePrior
    def __init__(self, relative_pose: _Optional[_Union[RelativePoseConstraint, _Mapping]] = ..., position_prior: _Optional[_Union[PositionPrior, _Mapping]] = ..., pose_prior: _Optional[_Union[PosePrior, _Mapping]] = ...) -> None: ...

class ConstraintRef(_message.Message):
    __slots__ = ("client_id", "id")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ...) -> None: ...

class RelativePoseConstraint(_message.Message):
    __slots__ = ("client_id", "id", "keyframe_i", "keyframe_j", "keyframe_i_from_keyframe_j", "information", "kind", "loss", "switched_off")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_I_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_J_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_I_FROM_KEYFRAME_J_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    keyframe_i: _map_pb2.KeyframeRef
    keyframe_j: _map_pb2.KeyframeRef
    keyframe_i_from_keyframe_j: _geometry_pb2.RigidTransform
    information: _geometry_pb2.InformationMatrix6
    kind: ConstraintKind
    loss: _optimization_pb2.Loss
    switched_off: _optimization_pb2.SwitchedOff
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., keyframe_i: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., keyframe_j: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., keyframe_i_from_keyframe_j: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix6, _Mapping]] = ..., kind: _Optional[_Union[ConstraintKind, str]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., switched_off: _Optional[_Union[_optimization_pb2.SwitchedOff, _Mapping]] = ...) -> None: ...

class SwitchedOffConstraint(_message.Message):
    __slots__ = ("constraint", "switched_off")
    CONSTRAINT_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_FIELD_NUMBER: _ClassVar[int]
    constraint: ConstraintRef
    switched_off: _optimization_pb2.SwitchedOff
    def __init__(self, constraint: _Optional[_Union[ConstraintRef, _Mapping]] = ..., switched_off: _Optional[_Union[_optimization_pb2.SwitchedOff, _Mapping]] = ...) -> None: ...

class PositionPrior(_message.Message):
    __slots__ = ("client_id", "id", "keyframe", "point_in_world", "point_in_camera", "information", "loss", "switched_off", "geodetic_point")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    POINT_IN_WORLD_FIELD_NUMBER: _ClassVar[int]
    POINT_IN_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_FIELD_NUMBER: _ClassVar[int]
    GEODETIC_POINT_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    keyframe: _map_pb2.KeyframeRef
    point_in_world: _geometry_pb2.Vector3
    point_in_camera: _geometry_pb2.Vector3
    information: _geometry_pb2.InformationMatrix3
    loss: _optimization_pb2.Loss
    switched_off: _optimization_pb2.SwitchedOff
    geodetic_point: _geometry_pb2.GeodeticPosition
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., point_in_world: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., point_in_camera: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix3, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., switched_off: _Optional[_Union[_optimization_pb2.SwitchedOff, _Mapping]] = ..., geodetic_point: _Optional[_Union[_geometry_pb2.GeodeticPosition, _Mapping]] = ...) -> None: ...

class PosePrior(_message.Message):
    __slots__ = ("client_id", "id", "keyframe", "world_from_camera", "information", "loss")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    LOSS_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    keyframe: _map_pb2.KeyframeRef
    world_from_camera: _geometry_pb2.RigidTransform
    information: _geometry_pb2.InformationMatrix6
    loss: _optimization_pb2.Loss
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., information: _Optional[_Union[_geometry_pb2.InformationMatrix6, _Mapping]] = ..., loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ...) -> None: ...

class PlaceSearch(_message.Message):
    __slots__ = ("keyframe", "candidates", "closure", "refusal", "earlier_closures")
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    CLOSURE_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    EARLIER_CLOSURES_FIELD_NUMBER: _ClassVar[int]
    keyframe: _map_pb2.KeyframeRef
    candidates: _containers.RepeatedCompositeFieldContainer[PlaceCandidate]
    closure: ConstraintRef
    refusal: PlaceRefusal
    earlier_closures: _containers.RepeatedCompositeFieldContainer[ConstraintRef]
    def __init__(self, keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., candidates: _Optional[_Iterable[_Union[PlaceCandidate, _Mapping]]] = ..., closure: _Optional[_Union[ConstraintRef, _Mapping]] = ..., refusal: _Optional[_Union[PlaceRefusal, _Mapping]] = ..., earlier_closures: _Optional[_Iterable[_Union[ConstraintRef, _Mapping]]] = ...) -> None: ...

class PlaceCandidate(_message.Message):
    __slots__ = ("keyframe", "score", "match_count", "refusal")
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    SCORE_FIELD_NUMBER: _ClassVar[int]
    MATCH_COUNT_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    keyframe: _map_pb2.KeyframeRef
    score: float
    match_count: int
    refusal: PlaceRefusal
    def __init__(self, keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., score: _Optional[float] = ..., match_count: _Optional[int] = ..., refusal: _Optional[_Union[PlaceRefusal, _Mapping]] = ...) -> None: ...

class PlaceRefusal(_message.Message):
    __slots__ = ("reason", "text")
    REASON_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    reason: str
    text: str
    def __init__(self, reason: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...
