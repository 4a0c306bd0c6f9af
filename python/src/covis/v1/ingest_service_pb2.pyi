from covis.v1 import camera_pb2 as _camera_pb2
from covis.v1 import constraint_pb2 as _constraint_pb2
from covis.v1 import map_pb2 as _map_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Durability(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DURABILITY_UNSPECIFIED: _ClassVar[Durability]
    DURABILITY_IN_MEMORY: _ClassVar[Durability]
    DURABILITY_DISK: _ClassVar[Durability]
    DURABILITY_REPLICATED: _ClassVar[Durability]

class AckStatus(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ACK_STATUS_UNSPECIFIED: _ClassVar[AckStatus]
    ACK_STATUS_RECEIVED: _ClassVar[AckStatus]
    ACK_STATUS_DURABLE: _ClassVar[AckStatus]
    ACK_STATUS_OPTIMIZED: _ClassVar[AckStatus]
    ACK_STATUS_REJECTED: _ClassVar[AckStatus]

class ViolationReason(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    VIOLATION_REASON_UNSPECIFIED: _ClassVar[ViolationReason]
    VIOLATION_REASON_MISSING: _ClassVar[ViolationReason]
    VIOLATION_REASON_NOT_FINITE: _ClassVar[ViolationReason]
    VIOLATION_REASON_OUT_OF_RANGE: _ClassVar[ViolationReason]
    VIOLATION_REASON_NOT_UNIT: _ClassVar[ViolationReason]
    VIOLATION_REASON_NOT_POSITIVE_DEFINITE: _ClassVar[ViolationReason]
    VIOLATION_REASON_WRONG_LENGTH: _ClassVar[ViolationReason]
    VIOLATION_REASON_UNKNOWN_REFERENCE: _ClassVar[ViolationReason]
    VIOLATION_REASON_ALREADY_EXISTS: _ClassVar[ViolationReason]
    VIOLATION_REASON_DUPLICATE: _ClassVar[ViolationReason]
    VIOLATION_REASON_NOT_PROJECTABLE: _ClassVar[ViolationReason]
    VIOLATION_REASON_INCONSISTENT: _ClassVar[ViolationReason]
    VIOLATION_REASON_UNKNOWN_VALUE: _ClassVar[ViolationReason]
    VIOLATION_REASON_UNIMPLEMENTED: _ClassVar[ViolationReason]
    VIOLATION_REASON_TOO_LARGE: _ClassVar[ViolationReason]
    VIOLATION_REASON_DISCONNECTED: _ClassVar[ViolationReason]
    VIOLATION_REASON_UNCONSTRAINED: _ClassVar[ViolationReason]
DURABILITY_UNSPECIFIED: Durability
DURABILITY_IN_MEMORY: Durability
DURABILITY_DISK: Durability
DURABILITY_REPLICATED: Durability
ACK_STATUS_UNSPECIFIED: AckStatus
ACK_STATUS_RECEIVED: AckStatus
ACK_STATUS_DURABLE: AckStatus
ACK_STATUS_OPTIMIZED: AckStatus
ACK_STATUS_REJECTED: AckStatus
VIOLATION_REASON_UNSPECIFIED: ViolationReason
VIOLATION_REASON_MISSING: ViolationReason
VIOLATION_REASON_NOT_FINITE: ViolationReason
VIOLATION_REASON_OUT_OF_RANGE: ViolationReason
VIOLATION_REASON_NOT_UNIT: ViolationReason
VIOLATION_REASON_NOT_POSITIVE_DEFINITE: ViolationReason
VIOLATION_REASON_WRONG_LENGTH: ViolationReason
VIOLATION_REASON_UNKNOWN_REFERENCE: ViolationReason
VIOLATION_REASON_ALREADY_EXISTS: ViolationReason
VIOLATION_REASON_DUPLICATE: ViolationReason
VIOLATION_REASON_NOT_PROJECTABLE: ViolationReason
VIOLATION_REASON_INCONSISTENT: ViolationReason
VIOLATION_REASON_UNKNOWN_VALUE: ViolationReason
VIOLATION_REASON_UNIMPLEMENTED: ViolationReason
VIOLATION_REASON_TOO_LARGE: ViolationReason
VIOLATION_REASON_DISCONNECTED: ViolationReason
VIOLATION_REASON_UNCONSTRAINED: ViolationReason

class IngestRequest(_message.Message):
    __slots__ = ("sequence", "open", "camera", "rig", "keyframe", "landmarks", "observations", "relative_pose", "position_prior", "pose_prior", "revoke_constraint", "remove_observations", "fuse_landmarks", "remove_landmarks", "remove_keyframe", "set_camera")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    OPEN_FIELD_NUMBER: _ClassVar[int]
    CAMERA_FIELD_NUMBER: _ClassVar[int]
    RIG_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_POSE_FIELD_NUMBER: _ClassVar[int]
    POSITION_PRIOR_FIELD_NUMBER: _ClassVar[int]
    POSE_PRIOR_FIELD_NUMBER: _ClassVar[int]
    REVOKE_CONSTRAINT_FIELD_NUMBER: _ClassVar[int]
    REMOVE_OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    FUSE_LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    REMOVE_LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    REMOVE_KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    SET_CAMERA_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    open: IngestOpen
    camera: _camera_pb2.Camera
    rig: _camera_pb2.Rig
    keyframe: _map_pb2.Keyframe
    landmarks: LandmarkBatch
    observations: ObservationBatch
    relative_pose: _constraint_pb2.RelativePoseConstraint
    position_prior: _constraint_pb2.PositionPrior
    pose_prior: _constraint_pb2.PosePrior
    revoke_constraint: RevokeConstraint
    remove_observations: RemoveObservations
    fuse_landmarks: FuseLandmarks
    remove_landmarks: RemoveLandmarks
    remove_keyframe: RemoveKeyframe
    set_camera: _camera_pb2.Camera
    def __init__(self, sequence: _Optional[int] = ..., open: _Optional[_Union[IngestOpen, _Mapping]] = ..., camera: _Optional[_Union[_camera_pb2.Camera, _Mapping]] = ..., rig: _Optional[_Union[_camera_pb2.Rig, _Mapping]] = ..., keyframe: _Optional[_Union[_map_pb2.Keyframe, _Mapping]] = ..., landmarks: _Optional[_Union[LandmarkBatch, _Mapping]] = ..., observations: _Optional[_Union[ObservationBatch, _Mapping]] = ..., relative_pose: _Optional[_Union[_constraint_pb2.RelativePoseConstraint, _Mapping]] = ..., position_prior: _Optional[_Union[_constraint_pb2.PositionPrior, _Mapping]] = ..., pose_prior: _Optional[_Union[_constraint_pb2.PosePrior, _Mapping]] = ..., revoke_constraint: _Optional[_Union[RevokeConstraint, _Mapping]] = ..., remove_observations: _Optional[_Union[RemoveObservations, _Mapping]] = ..., fuse_landmarks: _Optional[_Union[FuseLandmarks, _Mapping]] = ..., remove_landmarks: _Optional[_Union[RemoveLandmarks, _Mapping]] = ..., remove_keyframe: _Optional[_Union[RemoveKeyframe, _Mapping]] = ..., set_camera: _Optional[_Union[_camera_pb2.Camera, _Mapping]] = ...) -> None: ...

class IngestOpen(_message.Message):
    __slots__ = ("map_id", "client_id", "epoch", "options")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    OPTIONS_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    client_id: str
    epoch: int
    options: IngestOptions
    def __init__(self, map_id: _Optional[str] = ..., client_id: _Optional[str] = ..., epoch: _Optional[int] = ..., options: _Optional[_Union[IngestOptions, _Mapping]] = ...) -> None: ...

class IngestOptions(_message.Message):
    __slots__ = ("lock_step", "omit_solve_summary")
    LOCK_STEP_FIELD_NUMBER: _ClassVar[int]
    OMIT_SOLVE_SUMMARY_FIELD_NUMBER: _ClassVar[int]
    lock_step: bool
    omit_solve_summary: bool
    def __init__(self, lock_step: bool = ..., omit_solve_summary: bool = ...) -> None: ...

class LandmarkBatch(_message.Message):
    __slots__ = ("landmarks",)
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    landmarks: _containers.RepeatedCompositeFieldContainer[_map_pb2.Landmark]
    def __init__(self, landmarks: _Optional[_Iterable[_Union[_map_pb2.Landmark, _Mapping]]] = ...) -> None: ...

class ObservationBatch(_message.Message):
    __slots__ = ("keyframe", "observations")
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    keyframe: _map_pb2.KeyframeRef
    observations: _containers.RepeatedCompositeFieldContainer[_map_pb2.Observation]
    def __init__(self, keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ..., observations: _Optional[_Iterable[_Union[_map_pb2.Observation, _Mapping]]] = ...) -> None: ...

class RevokeConstraint(_message.Message):
    __slots__ = ("constraint",)
    CONSTRAINT_FIELD_NUMBER: _ClassVar[int]
    constraint: _constraint_pb2.ConstraintRef
    def __init__(self, constraint: _Optional[_Union[_constraint_pb2.ConstraintRef, _Mapping]] = ...) -> None: ...

class RemoveObservations(_message.Message):
    __slots__ = ("observations",)
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    observations: _containers.RepeatedCompositeFieldContainer[_map_pb2.ObservationRef]
    def __init__(self, observations: _Optional[_Iterable[_Union[_map_pb2.ObservationRef, _Mapping]]] = ...) -> None: ...

class FuseLandmarks(_message.Message):
    __slots__ = ("kept", "absorbed")
    KEPT_FIELD_NUMBER: _ClassVar[int]
    ABSORBED_FIELD_NUMBER: _ClassVar[int]
    kept: _map_pb2.LandmarkRef
    absorbed: _containers.RepeatedCompositeFieldContainer[_map_pb2.LandmarkRef]
    def __init__(self, kept: _Optional[_Union[_map_pb2.LandmarkRef, _Mapping]] = ..., absorbed: _Optional[_Iterable[_Union[_map_pb2.LandmarkRef, _Mapping]]] = ...) -> None: ...

class RemoveLandmarks(_message.Message):
    __slots__ = ("landmarks",)
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    landmarks: _containers.RepeatedCompositeFieldContainer[_map_pb2.LandmarkRef]
    def __init__(self, landmarks: _Optional[_Iterable[_Union[_map_pb2.LandmarkRef, _Mapping]]] = ...) -> None: ...

class RemoveKeyframe(_message.Message):
    __slots__ = ("keyframe",)
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    keyframe: _map_pb2.KeyframeRef
    def __init__(self, keyframe: _Optional[_Union[_map_pb2.KeyframeRef, _Mapping]] = ...) -> None: ...

class IngestResponse(_message.Message):
    __slots__ = ("opened", "ack")
    OPENED_FIELD_NUMBER: _ClassVar[int]
    ACK_FIELD_NUMBER: _ClassVar[int]
    opened: IngestOpened
    ack: IngestAck
    def __init__(self, opened: _Optional[_Union[IngestOpened, _Mapping]] = ..., ack: _Optional[_Union[IngestAck, _Mapping]] = ...) -> None: ...

class IngestOpened(_message.Message):
    __slots__ = ("next_sequence", "epoch", "durability", "revision", "max_message_bytes", "limits", "lock_step", "map_uid", "optimized_sequence", "next_keyframe_id", "next_landmark_id")
    NEXT_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    DURABILITY_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    MAX_MESSAGE_BYTES_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    LOCK_STEP_FIELD_NUMBER: _ClassVar[int]
    MAP_UID_FIELD_NUMBER: _ClassVar[int]
    OPTIMIZED_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    NEXT_KEYFRAME_ID_FIELD_NUMBER: _ClassVar[int]
    NEXT_LANDMARK_ID_FIELD_NUMBER: _ClassVar[int]
    next_sequence: int
    epoch: int
    durability: Durability
    revision: int
    max_message_bytes: int
    limits: _map_pb2.MapLimits
    lock_step: bool
    map_uid: str
    optimized_sequence: int
    next_keyframe_id: int
    next_landmark_id: int
    def __init__(self, next_sequence: _Optional[int] = ..., epoch: _Optional[int] = ..., durability: _Optional[_Union[Durability, str]] = ..., revision: _Optional[int] = ..., max_message_bytes: _Optional[int] = ..., limits: _Optional[_Union[_map_pb2.MapLimits, _Mapping]] = ..., lock_step: bool = ..., map_uid: _Optional[str] = ..., optimized_sequence: _Optional[int] = ..., next_keyframe_id: _Optional[int] = ..., next_landmark_id: _Optional[int] = ...) -> None: ...

class IngestAck(_message.Message):
    __slots__ = ("sequence", "status", "revision", "duplicate", "violations", "solve_id", "solve_summary", "solve_failure")
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    DUPLICATE_FIELD_NUMBER: _ClassVar[int]
    VIOLATIONS_FIELD_NUMBER: _ClassVar[int]
    SOLVE_ID_FIELD_NUMBER: _ClassVar[int]
    SOLVE_SUMMARY_FIELD_NUMBER: _ClassVar[int]
    SOLVE_FAILURE_FIELD_NUMBER: _ClassVar[int]
    sequence: int
    status: AckStatus
    revision: int
    duplicate: bool
    violations: _containers.RepeatedCompositeFieldContainer[ItemViolation]
    solve_id: int
    solve_summary: _optimization_pb2.SolveSummary
    solve_failure: SolveFailure
    def __init__(self, sequence: _Optional[int] = ..., status: _Optional[_Union[AckStatus, str]] = ..., revision: _Optional[int] = ..., duplicate: bool = ..., violations: _Optional[_Iterable[_Union[ItemViolation, _Mapping]]] = ..., solve_id: _Optional[int] = ..., solve_summary: _Optional[_Union[_optimization_pb2.SolveSummary, _Mapping]] = ..., solve_failure: _Optional[_Union[SolveFailure, _Mapping]] = ...) -> None: ...

class ItemViolation(_message.Message):
    __slots__ = ("field", "description", "reason")
    FIELD_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    field: str
    description: str
    reason: ViolationReason
    def __init__(self, field: _Optional[str] = ..., description: _Optional[str] = ..., reason: _Optional[_Union[ViolationReason, str]] = ...) -> None: ...

class SolveFailure(_message.Message):
    __slots__ = ("reason", "description")
    REASON_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTION_FIELD_NUMBER: _ClassVar[int]
    reason: ViolationReason
    description: str
    def __init__(self, reason: _Optional[_Union[ViolationReason, str]] = ..., description: _Optional[str] = ...) -> None: ...
