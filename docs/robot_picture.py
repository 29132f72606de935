"""The picture of the robot at the top of the README: `python docs/robot_picture.py`; it needs EGL."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from cspr_control.markers.robot_markers import (
    PATH_COLOUR,
    Shape,
    ShapeKind,
    cable_shape,
    frame_shapes,
    payload_shapes,
    trajectory_shape,
)
from cspr_control.reference.paper import paper_18
from cspr_kinematics import Payload, Robot, distribute_tensions, inverse_kinematics, static_wrench

ROOT = Path(__file__).parents[1]
PICTURE = Path(__file__).with_name("robot.png")
SIZE, OVERSAMPLING = (1200, 560), 2
CABLE, ROPE, PATH = 0.022, 0.03, 0.02  # m; thicker than they are, to be seen
PAYLOAD = Payload(200.0, np.array([0.0, 0.0, -0.35]))
PLATFORM_COLOUR = (0.1, 0.45, 0.85, 1.0)

SCENE = """
<mujoco>
  <visual>
    <global offwidth="{width}" offheight="{height}" fovy="30"/>
    <quality shadowsize="8192" offsamples="8"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.2 0.2 0.2" specular="0 0 0"/>
    <map znear="0.1" zfar="60" shadowclip="3"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="1 1 1" rgb2="0.86 0.90 0.94" width="512" height="512"/>
    <texture name="grid" type="2d" builtin="checker" rgb1="0.96 0.97 0.98" rgb2="0.91 0.92 0.935" width="512"
      height="512"/>
    <material name="floor" texture="grid" texrepeat="20 20" texuniform="false" reflectance="0.12"/>
  </asset>
  <worldbody>
    <light pos="1.5 -3 8" dir="-0.05 0.12 -1" directional="true" diffuse="0.42 0.42 0.42" specular="0 0 0"/>
    <geom type="plane" size="20 20 0.1" material="floor"/>
    {geometry}
  </worldbody>
</mujoco>
"""


def numbers(values: object) -> str:
    """Return numbers as an attribute of the scene."""
    return " ".join(f"{value:.5g}" for value in np.ravel(np.asarray(values, dtype=float)))


def geometry(shape: Shape) -> list[str]:
    """Return the elements of a shape of the live view."""
    colours = [(*rgb, 1.0) for rgb in shape.colours] or [shape.colour] * len(shape.points)
    width = numbers(shape.size[0] / 2.0)
    match shape.kind:
        case ShapeKind.SPHERE_LIST:
            return [
                f'<geom type="sphere" size="{width}" pos="{numbers(point)}" rgba="{numbers(colour)}"/>'
                for point, colour in zip(shape.points, colours, strict=True)
            ]
        case ShapeKind.CUBE:
            x, y, z, w = shape.quaternion
            return [
                f'<geom type="box" size="{numbers(np.divide(shape.size, 2.0))}" pos="{numbers(shape.points)}" '
                f'quat="{numbers((w, x, y, z))}" rgba="{numbers(shape.colour)}"/>'
            ]
        case ShapeKind.TEXT_VIEW_FACING:
            return []
    step = 2 if shape.kind is ShapeKind.LINE_LIST else 1
    return [
        f'<geom type="capsule" size="{width}" fromto="{numbers((a, b))}" rgba="{numbers(colour)}"/>'
        for a, b, colour in zip(shape.points[:-1:step], shape.points[1::step], colours[::step], strict=False)
        if np.linalg.norm(a - b) > 1e-6
    ]


def scene(robot: Robot) -> str:
    """Return the robot at work, with the tensions that hold it there."""
    trajectory = paper_18(robot.trajectory_center)
    pose = trajectory.sample(2.5).pose
    A = inverse_kinematics(robot, pose).wrench_matrix
    wrench = static_wrench(robot, pose, PAYLOAD)
    tensions = distribute_tensions(A, wrench, robot.tension_min, robot.tension_max, "closest").tensions
    x, y, z, w = pose.quaternion.tolist()
    platform = Shape(
        "platform", ShapeKind.CUBE, PLATFORM_COLOUR, tuple(robot.platform_size.tolist()), pose.position[None],
        quaternion=(x, y, z, w),
    )  # fmt: skip
    rope = np.stack((pose.position, pose.position + pose.rotation @ PAYLOAD.center_of_mass))
    shapes = [
        *frame_shapes(robot),
        replace(trajectory_shape(trajectory), size=(PATH,) * 3, colour=PATH_COLOUR),
        platform,
        replace(cable_shape(robot, pose, tensions), size=(CABLE,) * 3),
        *payload_shapes(pose, PAYLOAD),
        Shape("rope", ShapeKind.LINE_LIST, (0.3, 0.3, 0.3, 1.0), (ROPE,) * 3, rope),
    ]
    elements = "\n    ".join(element for shape in shapes for element in geometry(shape))
    width, height = (OVERSAMPLING * pixels for pixels in SIZE)
    return SCENE.format(width=width, height=height, geometry=elements)


def render(robot: Robot) -> NDArray[np.uint8]:
    """Return the picture in red, green and blue, (height, width, 3), larger than it will be."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    import mujoco  # reads the environment when it is imported

    model = mujoco.MjModel.from_xml_string(scene(robot))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0.1, 0.0, 1.22)
    camera.distance, camera.azimuth, camera.elevation = 9.9, 58.0, -17.0
    with mujoco.Renderer(model, OVERSAMPLING * SIZE[1], OVERSAMPLING * SIZE[0]) as renderer:
        renderer.update_scene(data, camera)
        pixels: NDArray[np.uint8] = renderer.render()
    return pixels


def main() -> None:
    """Write the picture."""
    picture = Image.fromarray(render(Robot.from_yaml(ROOT / "config" / "robot.yaml")))
    small = np.asarray(picture.resize(SIZE, Image.Resampling.LANCZOS))
    Image.fromarray(small // 4 * 4).save(PICTURE, optimize=True)  # half the size, and nobody sees it
    print(f"{PICTURE}: {PICTURE.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
