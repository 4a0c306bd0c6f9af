"""Constraints and priors of an ingest stream from arrays: references, vectors and information matrices."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from . import _poses
from .noise import pack_symmetric
from .v1 import (
    ConstraintKind,
    InformationMatrix3,
    InformationMatrix6,
    KeyframeRef,
    RelativePoseConstraint,
    Vector3,
)

Ref = int | tuple[str, int]
"""A keyframe of one's own by its id, one of another client as (client, id)."""


def ref(keyframe: Ref) -> KeyframeRef:
    """A reference of the wire."""
    client_id, id = ("", keyframe) if isinstance(keyframe, (int, np.integer)) else keyframe
    return KeyframeRef(client_id=client_id, id=int(id))


def vector3(name: str, value: npt.ArrayLike) -> Vector3:
    """A vector of the wire; `name` is that of the argument."""
    x, y, z = _poses.shaped(name, value, 3).tolist()
    return Vector3(x=x, y=y, z=z)


def information3(value: npt.ArrayLike) -> InformationMatrix3:
    """A 3×3 information matrix of the wire."""
    matrix = _poses.shaped("information", value, 3, 3)
    return InformationMatrix3(upper_triangle=pack_symmetric(matrix, "information"))


def information6(value: npt.ArrayLike) -> InformationMatrix6:
    """A 6×6 information matrix of the wire, translation first."""
    matrix = _poses.shaped("information", value, 6, 6)
    return InformationMatrix6(upper_triangle=pack_symmetric(matrix, "information"))


def relative_pose(
    id: int,
    keyframe_i: Ref,
    keyframe_j: Ref,
    i_from_j: npt.ArrayLike,
    information: npt.ArrayLike,
    kind: ConstraintKind,
) -> RelativePoseConstraint:
    """The measured pose of keyframe j in the frame of keyframe i."""
    return RelativePoseConstraint(
        id=id,
        keyframe_i=ref(keyframe_i),
        keyframe_j=ref(keyframe_j),
        keyframe_i_from_keyframe_j=_poses.rigid("i_from_j", i_from_j),
        information=information6(information),
        kind=kind,
    )
