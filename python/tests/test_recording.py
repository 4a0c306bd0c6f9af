"""A recording in the readers that Foxglove gives away for Python: every channel decodes, by the descriptors in the
recording and by Foxglove's own classes; transforms chain; counts are the map's."""

import importlib
import os
import shutil
import subprocess

import numpy as np
import pytest
from conftest import GUARD_S
from scene import K, SIZE, send

decoder = pytest.importorskip("mcap_protobuf.decoder", reason="mcap-protobuf-support is not installed")
reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
pytest.importorskip("foxglove_schemas_protobuf", reason="foxglove-schemas-protobuf is not installed")


@pytest.fixture
def recording(server, client, tmp_path):
    """A map of three keyframes and a closure, with its recording."""
    with client.ingest("room", "robot", lock_step=True) as session:
        session.camera(0, *SIZE, K)
        send(session, 1, 2, 3)
        session.finish(GUARD_S)
    program = os.environ.get("COVIS_BIN") or shutil.which("covis")
    out = tmp_path / "room.mcap"
    command = [os.path.abspath(program), "record", "room", str(out), "--server", server.url]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=GUARD_S, cwd=tmp_path)
    if "built without MCAP" in ran.stderr:
        pytest.skip("this covis was built without MCAP")
    assert ran.returncode == 0, ran.stderr
    return out


def matrix(position, orientation):
    x, y, z, w = orientation.x, orientation.y, orientation.z, orientation.w
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = position.x, position.y, position.z
    return pose


def test_every_channel_decodes_transforms_chain_and_counts_are_the_maps(client, recording):
    messages = {}
    with open(recording, "rb") as file:
        recorded = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
        summary = recorded.get_summary()
        for schema, channel, message, decoded in recorded.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append((schema.name, message, decoded))
    assert summary.statistics.message_count == sum(map(len, messages.values()))
    assert set(messages) == {c.topic for c in summary.channels.values()}

    # Foxglove's own classes read the same bytes, and leave nothing over.
    for name, message, _ in (row for rows in messages.values() for row in rows):
        if name.startswith("foxglove."):
            short = name.removeprefix("foxglove.")
            module = importlib.import_module(f"foxglove_schemas_protobuf.{short}_pb2")
            theirs = getattr(module, short).FromString(message.data)
            again = getattr(module, short)()
            again.CopyFrom(theirs)
            again.DiscardUnknownFields()
            assert again.ByteSize() == theirs.ByteSize(), name

    counts = client.get_map("room").counts
    cloud = messages["/covis/landmarks"][0][2]
    assert len(cloud.data) // cloud.point_stride == counts.positioned_landmark_count > 0
    state = messages["/covis/map"][0][2]
    assert state.keyframe_count == counts.keyframe_count == len(messages["/covis/pose/robot"])
    assert state.landmark_count == counts.positioned_landmark_count
    assert len(messages["/covis/calibration/robot/0"]) == counts.camera_count == 1
    calibration = messages["/covis/calibration/robot/0"][0][2]
    assert np.allclose(np.reshape(calibration.K, (3, 3)), K)
    assert len(messages["/covis/trajectory/robot"][0][2].poses) == counts.keyframe_count

    poses = list(client.watch("room").poses.values())
    for (_, message, in_map), pose in zip(messages["/covis/pose/robot"], poses, strict=True):
        assert np.allclose(matrix(in_map.pose.position, in_map.pose.orientation), pose)
        chains = [row[2] for row in messages["/tf"] if row[1].log_time == message.log_time]
        assert chains
        for chain in chains:
            links = {t.child_frame_id: t for t in chain.transforms}
            frame, found = "robot/camera", np.eye(4)
            while frame != "map":
                link = links[frame]
                found = matrix(link.translation, link.rotation) @ found
                frame = link.parent_frame_id
            assert np.allclose(found, pose)
