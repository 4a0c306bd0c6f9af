import datetime

from covis.v1 import geometry_pb2 as _geometry_pb2
from covis.v1 import optimization_pb2 as _optimization_pb2
from google.protobuf import timestamp_pb2 as _timestamp_pb2
from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class MapHintKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MAP_HINT_KIND_UNSPECIFIED: _ClassVar[MapHintKind]
    MAP_HINT_KIND_DEPTH_UNIT: _ClassVar[MapHintKind]
    MAP_HINT_KIND_SCENE_SIZE: _ClassVar[MapHintKind]
    MAP_HINT_KIND_POSES_INVERTED: _ClassVar[MapHintKind]
    MAP_HINT_KIND_PIXELS_SWAPPED: _ClassVar[MapHintKind]
    MAP_HINT_KIND_PIXELS_OUTSIDE_IMAGE: _ClassVar[MapHintKind]
    MAP_HINT_KIND_LANDMARKS_BEHIND_CAMERA: _ClassVar[MapHintKind]
    MAP_HINT_KIND_CLOCK_WENT_BACK: _ClassVar[MapHintKind]

class MapState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MAP_STATE_UNSPECIFIED: _ClassVar[MapState]
    MAP_STATE_OPEN: _ClassVar[MapState]
    MAP_STATE_FROZEN: _ClassVar[MapState]
    MAP_STATE_POISONED: _ClassVar[MapState]

class WhenFull(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    WHEN_FULL_UNSPECIFIED: _ClassVar[WhenFull]
    WHEN_FULL_REJECT: _ClassVar[WhenFull]
    WHEN_FULL_MARGINALIZE: _ClassVar[WhenFull]
    WHEN_FULL_SPARSIFY: _ClassVar[WhenFull]

class DescriptorKind(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    DESCRIPTOR_KIND_UNSPECIFIED: _ClassVar[DescriptorKind]
    DESCRIPTOR_KIND_BINARY: _ClassVar[DescriptorKind]
    DESCRIPTOR_KIND_FLOAT32: _ClassVar[DescriptorKind]
    DESCRIPTOR_KIND_UINT8: _ClassVar[DescriptorKind]

class LandmarkState(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    LANDMARK_STATE_UNSPECIFIED: _ClassVar[LandmarkState]
    LANDMARK_STATE_UNPOSITIONED: _ClassVar[LandmarkState]
    LANDMARK_STATE_POSITIONED: _ClassVar[LandmarkState]
MAP_HINT_KIND_UNSPECIFIED: MapHintKind
MAP_HINT_KIND_DEPTH_UNIT: MapHintKind
MAP_HINT_KIND_SCENE_SIZE: MapHintKind
MAP_HINT_KIND_POSES_INVERTED: MapHintKind
MAP_HINT_KIND_PIXELS_SWAPPED: MapHintKind
MAP_HINT_KIND_PIXELS_OUTSIDE_IMAGE: MapHintKind
MAP_HINT_KIND_LANDMARKS_BEHIND_CAMERA: MapHintKind
MAP_HINT_KIND_CLOCK_WENT_BACK: MapHintKind
MAP_STATE_UNSPECIFIED: MapState
MAP_STATE_OPEN: MapState
MAP_STATE_FROZEN: MapState
MAP_STATE_POISONED: MapState
WHEN_FULL_UNSPECIFIED: WhenFull
WHEN_FULL_REJECT: WhenFull
WHEN_FULL_MARGINALIZE: WhenFull
WHEN_FULL_SPARSIFY: WhenFull
DESCRIPTOR_KIND_UNSPECIFIED: DescriptorKind
DESCRIPTOR_KIND_BINARY: DescriptorKind
DESCRIPTOR_KIND_FLOAT32: DescriptorKind
DESCRIPTOR_KIND_UINT8: DescriptorKind
LANDMARK_STATE_UNSPECIFIED: LandmarkState
LANDMARK_STATE_UNPOSITIONED: LandmarkState
LANDMARK_STATE_POSITIONED: LandmarkState

class Map(_message.Message):
    __slots__ = ("map_id", "display_name", "policy", "state", "create_time", "update_time", "revision", "counts", "landmark_bounds", "clients", "uid", "adjustment_due", "merged_maps", "pending_work", "hints", "state_reason", "merged_map_count")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    DISPLAY_NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    CREATE_TIME_FIELD_NUMBER: _ClassVar[int]
    UPDATE_TIME_FIELD_NUMBER: _ClassVar[int]
    REVISION_FIELD_NUMBER: _ClassVar[int]
    COUNTS_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_BOUNDS_FIELD_NUMBER: _ClassVar[int]
    CLIENTS_FIELD_NUMBER: _ClassVar[int]
    UID_FIELD_NUMBER: _ClassVar[int]
    ADJUSTMENT_DUE_FIELD_NUMBER: _ClassVar[int]
    MERGED_MAPS_FIELD_NUMBER: _ClassVar[int]
    PENDING_WORK_FIELD_NUMBER: _ClassVar[int]
    HINTS_FIELD_NUMBER: _ClassVar[int]
    STATE_REASON_FIELD_NUMBER: _ClassVar[int]
    MERGED_MAP_COUNT_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    display_name: str
    policy: MapPolicy
    state: MapState
    create_time: _timestamp_pb2.Timestamp
    update_time: _timestamp_pb2.Timestamp
    revision: int
    counts: MapCounts
    landmark_bounds: _geometry_pb2.Bounds3
    clients: _containers.RepeatedCompositeFieldContainer[MapClient]
    uid: str
    adjustment_due: bool
    merged_maps: _containers.RepeatedCompositeFieldContainer[MergedMap]
    pending_work: PendingWork
    hints: _containers.RepeatedCompositeFieldContainer[MapHint]
    state_reason: str
    merged_map_count: int
    def __init__(self, map_id: _Optional[str] = ..., display_name: _Optional[str] = ..., policy: _Optional[_Union[MapPolicy, _Mapping]] = ..., state: _Optional[_Union[MapState, str]] = ..., create_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., update_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., revision: _Optional[int] = ..., counts: _Optional[_Union[MapCounts, _Mapping]] = ..., landmark_bounds: _Optional[_Union[_geometry_pb2.Bounds3, _Mapping]] = ..., clients: _Optional[_Iterable[_Union[MapClient, _Mapping]]] = ..., uid: _Optional[str] = ..., adjustment_due: bool = ..., merged_maps: _Optional[_Iterable[_Union[MergedMap, _Mapping]]] = ..., pending_work: _Optional[_Union[PendingWork, _Mapping]] = ..., hints: _Optional[_Iterable[_Union[MapHint, _Mapping]]] = ..., state_reason: _Optional[str] = ..., merged_map_count: _Optional[int] = ...) -> None: ...

class PendingWork(_message.Message):
    __slots__ = ("unoptimized_item_count", "place_search_count", "closure_adjustment", "optimization")
    UNOPTIMIZED_ITEM_COUNT_FIELD_NUMBER: _ClassVar[int]
    PLACE_SEARCH_COUNT_FIELD_NUMBER: _ClassVar[int]
    CLOSURE_ADJUSTMENT_FIELD_NUMBER: _ClassVar[int]
    OPTIMIZATION_FIELD_NUMBER: _ClassVar[int]
    unoptimized_item_count: int
    place_search_count: int
    closure_adjustment: bool
    optimization: bool
    def __init__(self, unoptimized_item_count: _Optional[int] = ..., place_search_count: _Optional[int] = ..., closure_adjustment: bool = ..., optimization: bool = ...) -> None: ...

class MapHint(_message.Message):
    __slots__ = ("kind", "client_id", "text")
    KIND_FIELD_NUMBER: _ClassVar[int]
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    kind: MapHintKind
    client_id: str
    text: str
    def __init__(self, kind: _Optional[_Union[MapHintKind, str]] = ..., client_id: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class MergedMap(_message.Message):
    __slots__ = ("map_id", "target_from_source", "client_ids", "scale", "client_count")
    MAP_ID_FIELD_NUMBER: _ClassVar[int]
    TARGET_FROM_SOURCE_FIELD_NUMBER: _ClassVar[int]
    CLIENT_IDS_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    CLIENT_COUNT_FIELD_NUMBER: _ClassVar[int]
    map_id: str
    target_from_source: _geometry_pb2.RigidTransform
    client_ids: _containers.RepeatedScalarFieldContainer[str]
    scale: float
    client_count: int
    def __init__(self, map_id: _Optional[str] = ..., target_from_source: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., client_ids: _Optional[_Iterable[str]] = ..., scale: _Optional[float] = ..., client_count: _Optional[int] = ...) -> None: ...

class MapCounts(_message.Message):
    __slots__ = ("camera_count", "rig_count", "keyframe_count", "landmark_count", "positioned_landmark_count", "observation_count", "constraint_count", "size_bytes", "switched_off_constraint_count")
    CAMERA_COUNT_FIELD_NUMBER: _ClassVar[int]
    RIG_COUNT_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    POSITIONED_LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINT_COUNT_FIELD_NUMBER: _ClassVar[int]
    SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    SWITCHED_OFF_CONSTRAINT_COUNT_FIELD_NUMBER: _ClassVar[int]
    camera_count: int
    rig_count: int
    keyframe_count: int
    landmark_count: int
    positioned_landmark_count: int
    observation_count: int
    constraint_count: int
    size_bytes: int
    switched_off_constraint_count: int
    def __init__(self, camera_count: _Optional[int] = ..., rig_count: _Optional[int] = ..., keyframe_count: _Optional[int] = ..., landmark_count: _Optional[int] = ..., positioned_landmark_count: _Optional[int] = ..., observation_count: _Optional[int] = ..., constraint_count: _Optional[int] = ..., size_bytes: _Optional[int] = ..., switched_off_constraint_count: _Optional[int] = ...) -> None: ...

class MapClient(_message.Message):
    __slots__ = ("client_id", "epoch", "next_sequence", "map_from_odom", "scale", "noise")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    EPOCH_FIELD_NUMBER: _ClassVar[int]
    NEXT_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    MAP_FROM_ODOM_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    NOISE_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    epoch: int
    next_sequence: int
    map_from_odom: _geometry_pb2.RigidTransform
    scale: float
    noise: ClientNoise
    def __init__(self, client_id: _Optional[str] = ..., epoch: _Optional[int] = ..., next_sequence: _Optional[int] = ..., map_from_odom: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., scale: _Optional[float] = ..., noise: _Optional[_Union[ClientNoise, _Mapping]] = ...) -> None: ...

class ClientNoise(_message.Message):
    __slots__ = ("odometry_translation_share", "odometry_rotation_rad", "pixel_factor", "depth_factor", "outlier_share")
    ODOMETRY_TRANSLATION_SHARE_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_ROTATION_RAD_FIELD_NUMBER: _ClassVar[int]
    PIXEL_FACTOR_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FACTOR_FIELD_NUMBER: _ClassVar[int]
    OUTLIER_SHARE_FIELD_NUMBER: _ClassVar[int]
    odometry_translation_share: float
    odometry_rotation_rad: float
    pixel_factor: float
    depth_factor: float
    outlier_share: float
    def __init__(self, odometry_translation_share: _Optional[float] = ..., odometry_rotation_rad: _Optional[float] = ..., pixel_factor: _Optional[float] = ..., depth_factor: _Optional[float] = ..., outlier_share: _Optional[float] = ...) -> None: ...

class MapPolicy(_message.Message):
    __slots__ = ("observation_loss", "constraint_loss", "window_keyframe_count", "min_shared_landmark_count", "gauge", "local_bundle_adjustment", "loop_closure_optimization", "max_iteration_count", "limits", "loop_closure_robustness", "when_full", "geodetic_anchor", "closure_adjustment", "odometry", "metric_odometry", "place_recognition")
    OBSERVATION_LOSS_FIELD_NUMBER: _ClassVar[int]
    CONSTRAINT_LOSS_FIELD_NUMBER: _ClassVar[int]
    WINDOW_KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MIN_SHARED_LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    GAUGE_FIELD_NUMBER: _ClassVar[int]
    LOCAL_BUNDLE_ADJUSTMENT_FIELD_NUMBER: _ClassVar[int]
    LOOP_CLOSURE_OPTIMIZATION_FIELD_NUMBER: _ClassVar[int]
    MAX_ITERATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    LIMITS_FIELD_NUMBER: _ClassVar[int]
    LOOP_CLOSURE_ROBUSTNESS_FIELD_NUMBER: _ClassVar[int]
    WHEN_FULL_FIELD_NUMBER: _ClassVar[int]
    GEODETIC_ANCHOR_FIELD_NUMBER: _ClassVar[int]
    CLOSURE_ADJUSTMENT_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_FIELD_NUMBER: _ClassVar[int]
    METRIC_ODOMETRY_FIELD_NUMBER: _ClassVar[int]
    PLACE_RECOGNITION_FIELD_NUMBER: _ClassVar[int]
    observation_loss: _optimization_pb2.Loss
    constraint_loss: _optimization_pb2.Loss
    window_keyframe_count: int
    min_shared_landmark_count: int
    gauge: _optimization_pb2.Gauge
    local_bundle_adjustment: bool
    loop_closure_optimization: bool
    max_iteration_count: int
    limits: MapLimits
    loop_closure_robustness: _optimization_pb2.ClosureRobustness
    when_full: WhenFull
    geodetic_anchor: _geometry_pb2.GeodeticPosition
    closure_adjustment: bool
    odometry: bool
    metric_odometry: bool
    place_recognition: PlaceRecognition
    def __init__(self, observation_loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., constraint_loss: _Optional[_Union[_optimization_pb2.Loss, _Mapping]] = ..., window_keyframe_count: _Optional[int] = ..., min_shared_landmark_count: _Optional[int] = ..., gauge: _Optional[_Union[_optimization_pb2.Gauge, str]] = ..., local_bundle_adjustment: bool = ..., loop_closure_optimization: bool = ..., max_iteration_count: _Optional[int] = ..., limits: _Optional[_Union[MapLimits, _Mapping]] = ..., loop_closure_robustness: _Optional[_Union[_optimization_pb2.ClosureRobustness, _Mapping]] = ..., when_full: _Optional[_Union[WhenFull, str]] = ..., geodetic_anchor: _Optional[_Union[_geometry_pb2.GeodeticPosition, _Mapping]] = ..., closure_adjustment: bool = ..., odometry: bool = ..., metric_odometry: bool = ..., place_recognition: _Optional[_Union[PlaceRecognition, _Mapping]] = ...) -> None: ...

class PlaceRecognition(_message.Message):
    __slots__ = ("enabled",)
    ENABLED_FIELD_NUMBER: _ClassVar[int]
    enabled: bool
    def __init__(self, enabled: bool = ...) -> None: ...

class MapLimits(_message.Message):
    __slots__ = ("max_keyframe_count", "max_landmark_count", "max_observation_count", "max_size_bytes", "max_queued_item_count", "max_client_count", "max_camera_count", "max_constraint_count", "max_prior_count")
    MAX_KEYFRAME_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_LANDMARK_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
    MAX_QUEUED_ITEM_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_CLIENT_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_CAMERA_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_CONSTRAINT_COUNT_FIELD_NUMBER: _ClassVar[int]
    MAX_PRIOR_COUNT_FIELD_NUMBER: _ClassVar[int]
    max_keyframe_count: int
    max_landmark_count: int
    max_observation_count: int
    max_size_bytes: int
    max_queued_item_count: int
    max_client_count: int
    max_camera_count: int
    max_constraint_count: int
    max_prior_count: int
    def __init__(self, max_keyframe_count: _Optional[int] = ..., max_landmark_count: _Optional[int] = ..., max_observation_count: _Optional[int] = ..., max_size_bytes: _Optional[int] = ..., max_queued_item_count: _Optional[int] = ..., max_client_count: _Optional[int] = ..., max_camera_count: _Optional[int] = ..., max_constraint_count: _Optional[int] = ..., max_prior_count: _Optional[int] = ...) -> None: ...

class KeyframeRef(_message.Message):
    __slots__ = ("client_id", "id")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ...) -> None: ...

class LandmarkRef(_message.Message):
    __slots__ = ("client_id", "id")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ...) -> None: ...

class Keyframe(_message.Message):
    __slots__ = ("client_id", "id", "capture_time", "camera_id", "rig_id", "world_from_camera", "world_from_rig", "odom_from_camera", "observations", "landmarks", "global_descriptor")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    CAPTURE_TIME_FIELD_NUMBER: _ClassVar[int]
    CAMERA_ID_FIELD_NUMBER: _ClassVar[int]
    RIG_ID_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_RIG_FIELD_NUMBER: _ClassVar[int]
    ODOM_FROM_CAMERA_FIELD_NUMBER: _ClassVar[int]
    OBSERVATIONS_FIELD_NUMBER: _ClassVar[int]
    LANDMARKS_FIELD_NUMBER: _ClassVar[int]
    GLOBAL_DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    capture_time: _timestamp_pb2.Timestamp
    camera_id: int
    rig_id: int
    world_from_camera: _geometry_pb2.RigidTransform
    world_from_rig: _geometry_pb2.RigidTransform
    odom_from_camera: _geometry_pb2.RigidTransform
    observations: _containers.RepeatedCompositeFieldContainer[Observation]
    landmarks: _containers.RepeatedCompositeFieldContainer[Landmark]
    global_descriptor: Descriptor
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., capture_time: _Optional[_Union[datetime.datetime, _timestamp_pb2.Timestamp, _Mapping]] = ..., camera_id: _Optional[int] = ..., rig_id: _Optional[int] = ..., world_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., world_from_rig: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., odom_from_camera: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., observations: _Optional[_Iterable[_Union[Observation, _Mapping]]] = ..., landmarks: _Optional[_Iterable[_Union[Landmark, _Mapping]]] = ..., global_descriptor: _Optional[_Union[Descriptor, _Mapping]] = ...) -> None: ...

class Observation(_message.Message):
    __slots__ = ("landmark", "camera_index", "pixel", "sigma_px", "depth_m", "sigma_depth_m", "descriptor")
    LANDMARK_FIELD_NUMBER: _ClassVar[int]
    CAMERA_INDEX_FIELD_NUMBER: _ClassVar[int]
    PIXEL_FIELD_NUMBER: _ClassVar[int]
    SIGMA_PX_FIELD_NUMBER: _ClassVar[int]
    DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    SIGMA_DEPTH_M_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    landmark: LandmarkRef
    camera_index: int
    pixel: _geometry_pb2.Vector2
    sigma_px: float
    depth_m: float
    sigma_depth_m: float
    descriptor: Descriptor
    def __init__(self, landmark: _Optional[_Union[LandmarkRef, _Mapping]] = ..., camera_index: _Optional[int] = ..., pixel: _Optional[_Union[_geometry_pb2.Vector2, _Mapping]] = ..., sigma_px: _Optional[float] = ..., depth_m: _Optional[float] = ..., sigma_depth_m: _Optional[float] = ..., descriptor: _Optional[_Union[Descriptor, _Mapping]] = ...) -> None: ...

class ObservationRef(_message.Message):
    __slots__ = ("keyframe", "landmark", "camera_index")
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    LANDMARK_FIELD_NUMBER: _ClassVar[int]
    CAMERA_INDEX_FIELD_NUMBER: _ClassVar[int]
    keyframe: KeyframeRef
    landmark: LandmarkRef
    camera_index: int
    def __init__(self, keyframe: _Optional[_Union[KeyframeRef, _Mapping]] = ..., landmark: _Optional[_Union[LandmarkRef, _Mapping]] = ..., camera_index: _Optional[int] = ...) -> None: ...

class Descriptor(_message.Message):
    __slots__ = ("kind", "name", "data")
    KIND_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    DATA_FIELD_NUMBER: _ClassVar[int]
    kind: DescriptorKind
    name: str
    data: bytes
    def __init__(self, kind: _Optional[_Union[DescriptorKind, str]] = ..., name: _Optional[str] = ..., data: _Optional[bytes] = ...) -> None: ...

class Landmark(_message.Message):
    __slots__ = ("client_id", "id", "point_in_world", "descriptor", "reference_keyframe", "observation_count", "state", "duplicate_of")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    ID_FIELD_NUMBER: _ClassVar[int]
    POINT_IN_WORLD_FIELD_NUMBER: _ClassVar[int]
    DESCRIPTOR_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_COUNT_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    DUPLICATE_OF_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    id: int
    point_in_world: _geometry_pb2.Vector3
    descriptor: Descriptor
    reference_keyframe: KeyframeRef
    observation_count: int
    state: LandmarkState
    duplicate_of: LandmarkRef
    def __init__(self, client_id: _Optional[str] = ..., id: _Optional[int] = ..., point_in_world: _Optional[_Union[_geometry_pb2.Vector3, _Mapping]] = ..., descriptor: _Optional[_Union[Descriptor, _Mapping]] = ..., reference_keyframe: _Optional[_Union[KeyframeRef, _Mapping]] = ..., observation_count: _Optional[int] = ..., state: _Optional[_Union[LandmarkState, str]] = ..., duplicate_of: _Optional[_Union[LandmarkRef, _Mapping]] = ...) -> None: ...

class ClientFrame(_message.Message):
    __slots__ = ("client_id", "map_from_odom", "keyframe", "scale")
    CLIENT_ID_FIELD_NUMBER: _ClassVar[int]
    MAP_FROM_ODOM_FIELD_NUMBER: _ClassVar[int]
    KEYFRAME_FIELD_NUMBER: _ClassVar[int]
    SCALE_FIELD_NUMBER: _ClassVar[int]
    client_id: str
    map_from_odom: _geometry_pb2.RigidTransform
    keyframe: KeyframeRef
    scale: float
    def __init__(self, client_id: _Optional[str] = ..., map_from_odom: _Optional[_Union[_geometry_pb2.RigidTransform, _Mapping]] = ..., keyframe: _Optional[_Union[KeyframeRef, _Mapping]] = ..., scale: _Optional[float] = ...) -> None: ...
