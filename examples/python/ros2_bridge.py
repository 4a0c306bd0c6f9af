"""A bridge from ROS 2: keyframes come on a topic and go to covis, map → odom goes out as tf.

`python ros2_bridge.py --ros-args -p url:=http://127.0.0.1:7411 -p map:=office -p client:=robot_1`

| topic | message |
|---|---|
| `camera_info` | sensor_msgs/CameraInfo of the images that are tracked, `plumb_bob` or `equidistant` |
| `keyframe` | sensor_msgs/PointCloud2, one row an observation: `u`, `v` (px), `id` of the landmark, and where known `depth` (m); the stamp is the exposure's, the frame the camera's optical frame |

The pose of the camera in `odom` is looked up in tf at the keyframe's stamp. `Bridge` is all that is not
ROS; nothing in it needs ROS to be installed.
"""

import covis
import numpy as np

# sensor_msgs/PointField: the numbers of its types.
TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
MODELS = {"plumb_bob": ("pinhole", 5), "equidistant": ("fisheye", 4), "": ("pinhole", 0)}


class Bridge:
    """What a robot sends and gets, in terms of messages' fields."""

    def __init__(self, client, map_id, client_id):
        self._client_id = client_id
        self._session = client.ingest(map_id, client_id)
        self._map = client.watch(map_id, omit_landmarks=True, omit_constraints=True)
        # An earlier run of the robot may have sent keyframes: ids go on after them.
        poses = self._map.poses
        ids = [key if isinstance(key, int) else key[1] for key in poses if self._is_own(key)]
        self._next_id = max(ids, default=-1) + 1
        self._has_camera = False

    def camera_info(self, info):
        """Takes the camera, once."""
        if self._has_camera:
            return
        if info.distortion_model not in MODELS:
            raise ValueError(f"the camera model {info.distortion_model} is not supported")
        model, count = MODELS[info.distortion_model]
        distortion = list(info.d)[:count]
        K = np.reshape(info.k, (3, 3))
        self._session.camera(0, info.width, info.height, K, distortion, model=model)
        self._has_camera = True

    def keyframe(self, cloud, odom_from_camera):
        """Sends a keyframe; waits while too much is unanswered. False before the camera is known."""
        if not self._has_camera:
            return False
        rows = as_rows(cloud)
        stamp = cloud.header.stamp
        t = np.datetime64(stamp.sec * 10**9 + stamp.nanosec, "ns")
        start = self.map_from_odom() @ odom_from_camera
        depths = rows["depth"] if "depth" in rows.dtype.names else None
        pixels = np.column_stack([rows["u"], rows["v"]])
        ids = rows["id"].astype(np.int64)
        self._session.keyframe(
            self._next_id, t, start, pixels, ids, depths, odom_from_camera=odom_from_camera
        )
        self._next_id += 1
        return True

    def map_from_odom(self):
        """The transform to publish, 4×4: the identity until the first keyframe is in the map."""
        found = self._map.map_from_odom(self._client_id)
        return np.eye(4) if found is None else found

    def close(self):
        """Waits until the server has everything, and ends."""
        self._session.finish(timeout=30)
        self._map.close()

    def _is_own(self, key):
        return isinstance(key, int) or key[0] == self._client_id


def as_rows(cloud):
    """A PointCloud2 as a structured array."""
    order = ">" if cloud.is_bigendian else "<"
    layout = np.dtype({
        "names": [field.name for field in cloud.fields],
        "formats": [order + TYPES[field.datatype] for field in cloud.fields],
        "offsets": [field.offset for field in cloud.fields],
        "itemsize": cloud.point_step,
    })
    return np.frombuffer(bytes(cloud.data), layout, count=cloud.width * cloud.height)


def from_transform(transform):
    """A geometry_msgs/Transform as 4×4."""
    t, q = transform.translation, transform.rotation
    return covis.join_pose([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])


def fill_transform(transform, pose):
    """A 4×4 into a geometry_msgs/Transform."""
    t, q = covis.split_pose(pose)
    transform.translation.x, transform.translation.y, transform.translation.z = t.tolist()
    q = q.tolist()
    transform.rotation.x, transform.rotation.y, transform.rotation.z, transform.rotation.w = q


def main():
    import rclpy
    from geometry_msgs.msg import TransformStamped
    from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
    from rclpy.executors import MultiThreadedExecutor
    from rclpy.node import Node
    from sensor_msgs.msg import CameraInfo, PointCloud2
    from tf2_ros import Buffer, TransformBroadcaster, TransformException, TransformListener

    rclpy.init()
    node = Node("covis_bridge")
    names = {"url": "http://127.0.0.1:7411", "map": "map", "client": "robot", "odom_frame": "odom",
             "map_frame": "map"}
    given = {name: node.declare_parameter(name, value).value for name, value in names.items()}
    client = covis.connect(given["url"])
    bridge = Bridge(client, given["map"], given["client"])
    buffer = Buffer()
    TransformListener(buffer, node)
    broadcaster = TransformBroadcaster(node)

    def on_keyframe(cloud):
        try:
            found = buffer.lookup_transform(
                given["odom_frame"], cloud.header.frame_id, cloud.header.stamp,
                timeout=rclpy.duration.Duration(seconds=0.2))
        except TransformException as error:
            node.get_logger().warning(f"a keyframe is left out: {error}")
            return
        bridge.keyframe(cloud, from_transform(found.transform))

    def publish():
        out = TransformStamped()
        out.header.stamp = node.get_clock().now().to_msg()
        out.header.frame_id, out.child_frame_id = given["map_frame"], given["odom_frame"]
        fill_transform(out.transform, bridge.map_from_odom())
        broadcaster.sendTransform(out)

    # Keyframes may wait for the server; tf goes on meanwhile, in a group of its own.
    keyframes = MutuallyExclusiveCallbackGroup()
    node.create_subscription(CameraInfo, "camera_info", bridge.camera_info, 1, callback_group=keyframes)
    node.create_subscription(PointCloud2, "keyframe", on_keyframe, 100, callback_group=keyframes)
    node.create_timer(0.05, publish)
    executor = MultiThreadedExecutor(2)
    executor.add_node(node)
    try:
        executor.spin()
    except KeyboardInterrupt:
        pass
    finally:
        bridge.close()
        client.close()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
