# SPDX-License-Identifier: MIT
"""A ROS 2 node that answers "where should the camera go next?" from depth images and poses.

Run it with `python examples/ros2_next_view.py --ros-args -p bounds:="[0.0, 0.0, 0.0, 6.0, 5.0, 2.7]"` where
rclpy, message_filters, sensor_msgs, geometry_msgs and std_srvs are installed. It listens to `depth`
(sensor_msgs/Image, 16UC1 in millimetres or 32FC1 in metres, rectified), `camera_info` and `pose`
(geometry_msgs/PoseStamped: the camera's optical frame in a world frame, z up), and offers the service
`next_view` (std_srvs/Trigger). A call takes the latest image into the map and publishes the next view on
`next_view_pose` (geometry_msgs/PoseStamped, optical frame), or answers why none pays.

`NextView` holds all but the node. It needs no ROS: a message is any object with the fields of its type.
"""

import dataclasses
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from nbv import Candidates, PinholeSensor, PlannerOptions, Requirement
from nbv.online.gain import BestView
from nbv.online.occupancy import VoxelMap
from nbv.online.planner import Decision, PlannerState, next_view
from nbv.scans.scan_map import with_known_noise
from nbv.visibility.viewpoints import room_lattice, sensor_directions, viewing_sphere
from scenes import InputError, Pose, RangeImage

_DEPTHS = {"16UC1": ("u2", 0.001), "32FC1": ("f4", 1.0)}  # kind of number, metres of a unit
_REACHED_M, _REACHED_COSINE = 0.2, 0.95  # a scan from so near the answer has tried what was answered


def depth_of(image: Any) -> np.ndarray:
    """Return the depth (rows, columns) of a sensor_msgs/Image in metres, NaN where nothing was measured.

    Raises InputError: another encoding than 16UC1 and 32FC1, fewer bytes than rows.
    """
    if image.encoding not in _DEPTHS:
        raise InputError(f"expected a depth image as {' or '.join(_DEPTHS)}, got {image.encoding!r}")
    kind, unit_m = _DEPTHS[image.encoding]
    number = np.dtype(kind).newbyteorder(">" if image.is_bigendian else "<")
    raw = np.frombuffer(bytes(image.data), np.uint8)
    if raw.size < image.height * image.step or image.step < image.width * number.itemsize:
        raise InputError(
            f"{raw.size} bytes in rows of {image.step} are not {image.height} x {image.width} depths"
        )
    rows = raw[: image.height * image.step].reshape(image.height, image.step)
    depth = np.ascontiguousarray(rows[:, : image.width * number.itemsize]).view(number).astype(np.float64)
    return np.where(np.isfinite(depth) & (depth > 0), depth * unit_m, np.nan)


def pose_of(pose: Any) -> Pose:
    """Return a geometry_msgs/Pose (of a camera's optical frame) as world from sensor."""
    place, turn = pose.position, pose.orientation
    rotation = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    return Pose.from_parts(rotation, np.array([place.x, place.y, place.z]))


def write_pose(pose: Pose, message: Any) -> Any:
    """Write a pose into a geometry_msgs/Pose, and return it."""
    message.position.x, message.position.y, message.position.z = pose.translation.tolist()
    turn = Rotation.from_matrix(pose.rotation).as_quat()
    message.orientation.x, message.orientation.y, message.orientation.z, message.orientation.w = turn.tolist()
    return message


class NextView:
    """A map of what depth images showed within `bounds` (2, 3), world frame, metres, and where to look next.

    Parameters
    ----------
    bounds : (2, 3) array
        Smallest and largest coordinates of what is to be seen.
    around : bool
        Whether the camera moves around an object; otherwise it moves within a room.
    range_m : (float, float)
        Depths that the camera measures, metres.
    options : PlannerOptions, optional
        Voxels, clearance, stopping; without tripod and floor when not given.
    """

    def __init__(
        self,
        bounds: np.ndarray,
        *,
        around: bool = False,
        range_m: tuple[float, float] = (0.3, 5.0),
        options: PlannerOptions | None = None,
    ) -> None:
        self.around, self.range_m = around, range_m
        self.options = options or PlannerOptions(on_floor=False)
        self.bounds = np.reshape(np.asarray(bounds, dtype=np.float64), (2, 3))
        voxels = VoxelMap.unknown(self.bounds, voxel_m=self.options.voxel_m, outside_is_empty=around)
        self.state = PlannerState.of(voxels)
        self._answer: BestView | None = None

    def sensor_of(self, info: Any) -> PinholeSensor:
        """Return the camera of a sensor_msgs/CameraInfo. Raises InputError: its images are not rectified."""
        if np.any(np.asarray(info.d, dtype=np.float64)):
            raise InputError("the camera has a distortion: subscribe to its rectified depth image")
        fx, _, cx, _, fy, cy = np.asarray(info.k, dtype=np.float64)[:6]
        return PinholeSensor.from_intrinsics(
            info.width, info.height, fx=fx, fy=fy, cx=cx, cy=cy, range_m=self.range_m
        )

    def scan_of(self, image: Any, info: Any, pose: Any) -> RangeImage:
        """Return a depth image as a scan; depths outside `range_m` count as not measured.

        Raises InputError: image and camera have different sizes, and as `depth_of` and `sensor_of`.
        """
        depth = depth_of(image)
        if depth.shape != (info.height, info.width):
            raise InputError(f"the image is {depth.shape}, its camera {info.height, info.width}")
        near, far = self.range_m
        rays = self.sensor_of(info).projection.directions()
        points = rays * (np.where((depth >= near) & (depth <= far), depth, np.nan) / rays[..., 2])[..., None]
        return RangeImage.from_points(points, self.sensor_of(info).projection, pose_of(pose))

    def take(self, image: Any, info: Any, pose: Any) -> Decision:
        """Take an image into the map, and return the next view or the reason why none pays.

        A pixel without depth says nothing: depth cameras also lose dark, shiny and near surface.
        """
        sensor, scan = self.sensor_of(info), with_known_noise(self.scan_of(image, info, pose))
        here, answer = scan.world_from_sensor, self._answer
        if answer is not None and _reached(answer.pose, here):
            self.state = self.state.after_choice(answer)
        clearance = 0.0 if self.around else self.options.clearance_m
        self.state = dataclasses.replace(
            self.state, voxels=self.state.voxels.with_given([scan], sensor, clearance)
        )
        decision = next_view(
            self.state, self.candidates(sensor), here,
            sensor=sensor, requirement=Requirement(), options=self.options,
        )  # fmt: skip
        self._answer = decision.view
        return decision

    def candidates(self, sensor: PinholeSensor) -> Candidates:
        """Return where the camera may go: a sphere around an object, or places all over a room."""
        if self.around:
            return viewing_sphere(self.bounds, sensor, all_round=False)
        height = self.bounds[1, 2] - self.bounds[0, 2]
        heights = tuple(np.arange(self.options.clearance_m, height, 0.5).tolist())
        places = room_lattice(self.bounds, heights_m=heights, clearance_m=self.options.clearance_m)
        return Candidates(places, sensor_directions(sensor, 1))


def _reached(wanted: Pose, here: Pose) -> bool:
    """Whether the camera is where it was sent."""
    is_near = np.linalg.norm(wanted.translation - here.translation) <= _REACHED_M
    return bool(is_near and wanted.rotation[:, 2] @ here.rotation[:, 2] >= _REACHED_COSINE)


def main() -> None:
    """Run the node until it is stopped."""
    import message_filters  # these come with ROS 2
    import rclpy
    from geometry_msgs.msg import PoseStamped
    from rclpy.node import Node
    from sensor_msgs.msg import CameraInfo, Image
    from std_srvs.srv import Trigger

    rclpy.init()
    node = Node("unseen_next_view")
    bounds = node.declare_parameter("bounds", [0.0, 0.0, 0.0, 6.0, 5.0, 2.7]).value
    around = node.declare_parameter("around", False).value
    range_m = node.declare_parameter("range_m", [0.3, 5.0]).value
    planner = NextView(np.reshape(bounds, (2, 3)), around=around, range_m=tuple(range_m))
    latest: list[tuple[Any, Any, Any]] = []
    answers = node.create_publisher(PoseStamped, "next_view_pose", 1)

    def answer(_: Any, response: Any) -> Any:
        try:
            if not latest:
                raise InputError("no depth image with camera and pose has arrived yet")
            image, info, pose = latest[-1]
            decision = planner.take(image, info, pose.pose)
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = decision.view is not None, decision.reason or ""
        if decision.view is not None:
            message = PoseStamped(header=pose.header)
            write_pose(decision.view.pose, message.pose)
            answers.publish(message)
            response.message = f"{decision.view.gain_m2:.2f} m2 expected"
        return response

    inputs = [
        message_filters.Subscriber(node, kind, topic)
        for kind, topic in ((Image, "depth"), (CameraInfo, "camera_info"), (PoseStamped, "pose"))
    ]
    together = message_filters.ApproximateTimeSynchronizer(inputs, queue_size=10, slop=0.05)
    together.registerCallback(lambda *messages: latest.__setitem__(slice(None), [messages]))
    node.create_service(Trigger, "next_view", answer)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()


if __name__ == "__main__":
    main()
