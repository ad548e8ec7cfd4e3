# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chessboards as two cameras of a known rig see them: exact projection with distortion, then blur and noise."""
import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from all_in_focus.calibration.board import Pair
from all_in_focus.calibration.rig_fit import map_points
from all_in_focus.files.rig import Camera, Rig, rotation_matrix

COLUMNS, ROWS, SQUARE = 8, 6, 0.045  # inner corners; metres


def true_rig():
    """A Kinect's IR camera beside a colour camera, rotated a little; both with the distortion of a usual lens."""
    ir = Camera.pinhole("ir", 640, 480, 583.9, 585.2, 316.4, 245.1)
    ir.D = np.array([-0.12, 0.18, 0.0011, -0.0007, 0.0])
    color = Camera.pinhole("color", 800, 600, 985.0, 987.5, 391.0, 307.0)
    color.D = np.array([-0.21, 0.09, -0.0006, 0.0009, 0.0])
    turn = rotation_matrix(Rotation.from_euler("xyz", [-1.4, -2.2, 1.1], degrees=True))
    return Rig(ir, color, turn, [-0.034, 0.052, 0.021])


def corner_points(pose, board=(COLUMNS, ROWS, SQUARE)):
    """Inner corners, N x 3 in m, in the frame that `pose` leads to; row by row."""
    columns, rows, square = board
    y, x = np.mgrid[:rows, :columns]
    flat = np.stack([x - (columns - 1) / 2, y - (rows - 1) / 2, 0 * x], axis=-1).reshape(-1, 3) * square
    return flat @ pose[0].T + pose[1]


def project(camera, points):
    return cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.K, camera.D)[0][:, 0]


def board_poses(rig, count, seed=0, near=0.6):
    """Poses of the board (R 3x3, t of its middle, m) in the depth camera: spread, tilted, whole in both pictures."""
    rng = np.random.default_rng(seed)
    poses = []
    while len(poses) < count:
        z = rng.uniform(near, 1.6)
        middle = np.array([rng.uniform(-0.5, 0.5) * z, rng.uniform(-0.38, 0.38) * z, z])
        turn = Rotation.from_euler("zyx", rng.uniform(-1, 1, 3) * [25, 45, 45], degrees=True)
        pose = (rotation_matrix(turn), middle)
        if all(_in_picture(camera, corner_points(seen))
               for camera, seen in ((rig.depth, pose), (rig.color, in_color_camera(rig, pose)))):
            poses.append(pose)
    return poses


def _in_picture(camera, points):
    u, v = project(camera, points).T
    return min(u.min(), v.min(), camera.width - u.max(), camera.height - v.max()) > 25


def seen_pairs(rig, poses, noise=0.05, seed=0):
    """The corners as found in both pictures, without any picture; noise: pixels, standard deviation."""
    rng = np.random.default_rng(seed)

    def seen(camera, pose):
        points = project(camera, corner_points(pose))
        return points + rng.normal(0, noise, points.shape)

    return [Pair(f"{number:02d}", seen(rig.depth, pose), seen(rig.color, in_color_camera(rig, pose)))
            for number, pose in enumerate(poses)]


def mapping_error(one, other):
    """Pixels of the colour picture between where two rigs put depth pixels at 0.8 to 4 m, as far as it shows them."""
    at = [map_points((rig.depth.K, rig.color.K), (rig.depth.D, rig.color.D), rig.R, rig.t,
                     (rig.depth.width, rig.depth.height)) for rig in (one, other)]
    inside = ((at[1] >= 0) & (at[1] < (other.color.width, other.color.height))).all(axis=1)
    return np.linalg.norm(at[0] - at[1], axis=1)[inside]


def in_color_camera(rig, pose):
    rotation, position = pose
    return rig.R @ rotation, rig.R @ position + rig.t


def _square_wave(cells, per_pixel):
    """+1 and -1 in turn from cell to cell, mixed where a pixel lies on a line between two."""
    line = np.rint(cells)
    return np.where(line % 2 == 0, 1, -1) * np.clip(2 * (cells - line) / per_pixel, -1, 1)


def _cover(cells, per_pixel, low, high):
    """Share of a pixel that lies in low..high."""
    return np.clip((cells - low) / per_pixel + 0.5, 0, 1) * np.clip((high - cells) / per_pixel + 0.5, 0, 1)


def rays(camera):
    """Direction (x / z, y / z) of each pixel's ray, H x W x 2."""
    v, u = np.mgrid[:camera.height, :camera.width].astype(float)
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 20, 1e-9)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    straight = cv2.undistortPointsIter(pixels, camera.K, camera.D, None, None, criteria)
    return straight.reshape(camera.height, camera.width, 2)


def render(camera_rays, pose, black=35.0, white=215.0, background=90.0, blur=0.7, noise=2.0, seed=0, scale=1,
           board=(COLUMNS, ROWS, SQUARE)):
    """Picture of a board (inner corners, m) at `pose`: 8 bit, or 16 bit where brightness is scaled by more than 1."""
    columns, rows, square = board
    rotation, position = pose
    # Homography from rays to the board's plane, whose axes are the first two columns of the rotation.
    plane = np.linalg.inv(np.column_stack([rotation[:, 0], rotation[:, 1], position]))
    on_board = camera_rays @ plane[:, :2].T + plane[:, 2]
    x = on_board[..., 0] / on_board[..., 2] / square + (columns + 1) / 2
    y = on_board[..., 1] / on_board[..., 2] / square + (rows + 1) / 2
    dx, dy = (np.hypot(*np.gradient(cells)) for cells in (x, y))
    checks = (black + white) / 2 + (black - white) / 2 * _square_wave(x, dx) * _square_wave(y, dy)
    inside = _cover(x, dx, 0, columns + 1) * _cover(y, dy, 0, rows + 1)
    sheet = _cover(x, dx, -0.6, columns + 1.6) * _cover(y, dy, -0.6, rows + 1.6)
    image = background + sheet * (white + inside * (checks - white) - background)
    image = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
    image += np.random.default_rng(seed).normal(0, noise, image.shape)
    return np.clip(np.rint(image * scale), 0, 65535 if scale > 1 else 255).astype(np.uint16 if scale > 1 else np.uint8)


def write_views(folder, rig, poses, moved):
    """folder/depth and folder/color: the board at each pose, 16-bit infrared and colour; moved: pose numbers at which
    the board lies 2 cm farther right in the colour picture."""
    camera_rays = rays(rig.depth), rays(rig.color)
    for name in ("depth", "color"):
        (folder / name).mkdir(parents=True)
    for number, pose in enumerate(poses):
        ir = render(camera_rays[0], pose, 40, 110, 60, blur=1.1, noise=2, seed=number, scale=8)
        shifted = (pose[0], pose[1] + [0.02 * (number in moved), 0, 0])
        color = render(camera_rays[1], in_color_camera(rig, shifted), blur=0.8, noise=3, seed=1000 + number)
        cv2.imwrite(str(folder / "depth" / f"{number:02d}.png"), ir)
        cv2.imwrite(str(folder / "color" / f"{number:02d}.jpg"), cv2.cvtColor(color, cv2.COLOR_GRAY2BGR),
                    [cv2.IMWRITE_JPEG_QUALITY, 97])
    return folder
