# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""fuse_stack --save-cloud: coloured points in metres, in the colour camera's frame."""
import cv2
import numpy as np
import pytest

from all_in_focus.files.rig import Camera, load_rig, save_rig
from file_helpers import focus_file
from tool_helpers import NEAR, SIZE, TwoPlanes, expect_refusal, fuse_stack, read, succeeded, unchanged, write

POINT = np.dtype([("at", "<f4", 3), ("color", "u1", 3)])


@pytest.fixture
def planes(tmp_path):
    return TwoPlanes(tmp_path / "planes")


def read_ply(path):
    """(positions N x 3, m; colours N x 3, BGR); the header is what viewers expect."""
    header, data = path.read_bytes().split(b"end_header\n", 1)
    lines = header.decode().splitlines()
    count = int(next(line.split()[-1] for line in lines if line.startswith("element vertex ")))
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    assert [line for line in lines if line.startswith("property")] == [
        *(f"property float {axis}" for axis in "xyz"), *(f"property uchar {color}" for color in ("red", "green", "blue"))]
    points = np.frombuffer(data, POINT)
    assert len(points) == count
    return points["at"], points["color"][:, ::-1]


def places(camera, depth):
    """What the positions should be, N x 3, and which pixels have one."""
    v, u = np.nonzero(depth)
    lens = cv2.fisheye if camera.is_fisheye else cv2
    rays = lens.undistortPoints(np.column_stack([u, v]).astype(float).reshape(-1, 1, 2), camera.K, camera.D)[:, 0]
    return np.column_stack([rays, np.ones(len(rays))]) * depth[v, u, None] / 1000.0, (v, u)


@pytest.mark.parametrize("lens", ["pinhole", "distorted", "fisheye"])
def test_every_pixel_with_known_depth(planes, lens):
    camera = Camera.pinhole("camera", *SIZE, 60.0, 61.0, 30.5, 24.5)
    if lens == "distorted":
        camera.D = np.array([0.1, -0.05, 0.001, 0.002, 0.01])
    elif lens == "fisheye":
        camera.D, camera.distortion_model = np.array([-0.02, 0.004, -0.001, 0.0002]), "equidistant"
    rig = load_rig(planes.rig)
    rig.depth = rig.color = camera
    save_rig(planes.rig, rig)
    depth = planes.depth.copy()
    depth[10:20, 5:30] = 0
    write(planes.depth_file, depth)
    succeeded(fuse_stack(planes.stack, "--output", planes.output("o.png"), "--save-cloud", planes.output("o.ply"), "--rig",
                         planes.rig, "--registered-depth", planes.depth_file))
    at, colors = read_ply(planes.output("o.ply"))
    wanted, pixels = places(camera, depth)
    assert np.allclose(at, wanted, atol=1e-5)
    assert np.array_equal(colors, read(planes.output("o.png"))[pixels])


def test_depth_of_the_sensor_is_not_filled(planes):
    depth = planes.depth.copy()
    depth[10:20, 5:30] = 0
    write(planes.depth_file, depth)
    succeeded(fuse_stack(planes.stack, "--output", planes.output("o.png"), *planes.with_depth, "--save-cloud",
                         planes.output("o.ply"), "--save-measured", planes.output("m.png")))
    at, _ = read_ply(planes.output("o.ply"))
    assert len(at) == np.count_nonzero(read(planes.output("m.png"))) < SIZE[0] * SIZE[1]
    assert np.isclose(at[0, 2], NEAR / 1000)


def test_depth_at_another_resolution(planes):
    """The depth map is half as wide: each of its pixels gives four points, and the middle stays the middle."""
    write(planes.depth_file, np.ascontiguousarray(planes.depth[::2, ::2]))
    succeeded(fuse_stack(planes.stack, "--output", planes.output("o.png"), "--save-cloud", planes.output("o.ply"), "--rig",
                         planes.rig, "--registered-depth", planes.depth_file))
    at, _ = read_ply(planes.output("o.ply"))
    wanted, _ = places(load_rig(planes.rig).color, planes.depth)
    assert np.allclose(at, wanted, atol=1e-5)


def test_by_the_depth_of_mode_restored(planes):
    focus = focus_file(planes.folder, "frames: [{file: 00.png, focus_mm: 700}, {file: 01.png, focus_mm: 1000}, "
                                      "{file: 02.png, focus_mm: 3000}]")
    succeeded(fuse_stack(planes.stack, "--output", planes.output("o.png"), *planes.with_depth, "--focus", focus,
                         "--mode", "restored", "--save-cloud", planes.output("o.ply"), "--save-depth", planes.output("z.png")))
    at, colors = read_ply(planes.output("o.ply"))
    restored = read(planes.output("z.png"))
    assert len(at) == SIZE[0] * SIZE[1] and np.allclose(at[:, 2], restored.ravel() / 1000)
    assert np.array_equal(colors, read(planes.output("o.png")).reshape(-1, 3))


def test_without_rig_or_depth(planes):
    with unchanged(planes.folder):
        for arguments, complaint in ((["--registered-depth", planes.depth_file, "--optics", "24,4,0.019"], "needs --rig"),
                                     (["--rig", planes.rig], "there is no depth")):
            expect_refusal(fuse_stack(planes.stack, "--output", planes.output("o.png"), "--save-cloud",
                                      planes.output("o.ply"), *arguments), "fuse_stack", complaint)
