# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts of the calibration: corners in pictures of all kinds, the order of corners, bad views, coverage."""
import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from all_in_focus.calibration import live
from all_in_focus.calibration.board import Board, Pair, find_corners
from all_in_focus.calibration.fit_report import view_warnings
from all_in_focus.calibration.live import ADVICE, LiveView, measure, moved, spanned
from all_in_focus.calibration.rig_fit import fit_camera, fit_rig
from all_in_focus.calibration.rig_folder import RigFolder, build_rig, depth_size
from all_in_focus.files.rig import Camera, rotation_matrix
from all_in_focus.image_messages import color_message

from board_rendering import (SQUARE, board_poses, corner_points, in_color_camera, mapping_error, project, rays, render,
                             seen_pairs, true_rig)

BOARD = Board.parse("6x8", 1000 * SQUARE)
SIZES = ((640, 480), (800, 600))
NAMES = ("depth", "color")


def tilted(yaw, pitch, roll, position):
    return rotation_matrix(Rotation.from_euler("zyx", [roll, yaw, pitch], degrees=True)), np.array(position)


def corner_error(camera, picture, pose):
    """RMS in pixels; None where no board is found."""
    found = find_corners(picture, BOARD)
    if found is None:
        return None
    truth = project(camera, corner_points(pose))
    return min(np.sqrt(np.mean(np.sum((order - truth) ** 2, axis=1))) for order in BOARD.orders(found))


@pytest.mark.parametrize("width, height, focal, kind, expected", [
    (640, 480, 580, dict(blur=0.7, noise=2), 0.1),
    (640, 480, 580, dict(blur=1.3, noise=8, black=60, white=140, background=60), 0.5),  # infrared, dim
    (640, 480, 580, dict(blur=0.7, noise=1, black=4, white=20, background=4, scale=40), 0.3),
    (200, 150, 190, dict(blur=0.5, noise=1), 0.1),
    (1600, 500, 900, dict(blur=1.0, noise=2), 0.1),
    (2400, 1800, 2300, dict(blur=3.0, noise=4), 0.5),
])
def test_corners_are_found_to_a_fraction_of_a_pixel(width, height, focal, kind, expected):
    camera = Camera.pinhole("any", width, height, focal, focal, width / 2 - 0.3, height / 2 + 0.2)
    pose = tilted(35, -20, 10, [0.03, -0.02, 0.85])
    assert corner_error(camera, render(rays(camera), pose, **kind), pose) < expected


def test_no_corners_where_there_is_no_board():
    noise = np.random.default_rng(0).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    assert find_corners(noise, BOARD) is None and find_corners(np.zeros((240, 320), np.uint16), BOARD) is None


def shuffled(pairs, board):
    """Every picture's corners in any of the orders that a search may give."""
    rng = np.random.default_rng(1)

    def any_order(corners):
        orders = board.orders(corners)
        return orders[rng.integers(len(orders))]

    return [Pair(pair.name, any_order(pair.depth), any_order(pair.color)) for pair in pairs]


def rig_of(fit):
    return build_rig(fit, NAMES, SIZES)


@pytest.mark.parametrize("roll", [0, 90, 180])
def test_the_order_of_corners_does_not_matter_however_the_cameras_are_mounted(roll):
    truth = true_rig()
    poses = board_poses(truth, 12)
    truth.R = rotation_matrix(Rotation.from_euler("z", roll, degrees=True)) @ truth.R
    truth.color.width = truth.color.height = 4000  # whatever the roll, the board stays in the picture
    truth.color.K[:2, 2] = 2000
    truth.color.D[:] = 0
    fit = fit_rig(BOARD, shuffled(seen_pairs(truth, poses), BOARD), (SIZES[0], (4000, 4000)))
    assert np.linalg.norm(fit.t - truth.t) < 0.002 and not fit.remarks
    assert np.allclose(fit.R, truth.R, atol=3e-3)


def test_square_boards_too():
    truth, board = true_rig(), Board(6, 6, SQUARE)
    near = [(pose[0], pose[1]) for pose in board_poses(truth, 14)]
    pairs = []
    for number, pose in enumerate(near):
        points = corner_points(pose, (6, 6, SQUARE))
        seen = corner_points(in_color_camera(truth, pose), (6, 6, SQUARE))
        pairs.append(Pair(str(number), project(truth.depth, points), project(truth.color, seen)))
    fit = fit_rig(board, shuffled(pairs, board), SIZES)
    assert mapping_error(rig_of(fit), truth).max() < 0.01 and not fit.remarks


def test_several_moved_boards_and_a_bad_picture_are_left_out():
    truth = true_rig()
    pairs = seen_pairs(truth, board_poses(truth, 20))
    for number, shift in ((2, 300.0), (5, 40.0), (9, -3.0), (13, 12.0)):
        pairs[number].color = pairs[number].color + [shift, 0]
    pairs[16].depth = pairs[16].depth + np.random.default_rng(0).normal(0, 2, pairs[16].depth.shape)
    fit = fit_rig(BOARD, pairs, SIZES)
    assert sorted(fit.remarks) == ["02", "05", "09", "13", "16"] and list(fit.depth.left_out) == ["16"]
    assert np.percentile(mapping_error(rig_of(fit), truth), 95) < 0.3


def test_a_mirrored_picture_is_suspected():
    truth = true_rig()
    pairs = [Pair(pair.name, [639, 0] + [-1, 1] * pair.depth.reshape(6, 8, 2)[:, ::-1].reshape(-1, 2), pair.color)
             for pair in seen_pairs(truth, board_poses(truth, 12))]
    with pytest.raises(ValueError, match="is one camera's picture mirrored"):
        fit_rig(BOARD, pairs, SIZES)


def test_a_known_camera_may_have_the_rational_distortion():
    truth = true_rig()
    truth.color.D = np.array([0.4, -0.3, 0.001, -0.0005, 0.02, 0.6, -0.2, 0.01])
    pairs = seen_pairs(truth, board_poses(truth, 10))
    fit = fit_rig(BOARD, pairs, SIZES, (None, truth.color))
    rig = rig_of(fit)
    assert np.array_equal(rig.color.D, truth.color.D) and rig.color.distortion_model == "rational_polynomial"
    assert np.linalg.norm(rig.t - truth.t) < 0.004 and fit.rms < 0.1 and not fit.remarks


def test_a_known_camera_whose_principal_point_lies_outside_the_picture():
    truth = true_rig()
    pairs = seen_pairs(truth, board_poses(truth, 6))
    truth.color.K[0, 2] = -1
    with pytest.raises(ValueError, match="the color camera: .* compare --color-info with the pictures$"):
        fit_rig(BOARD, pairs, SIZES, (None, truth.color))


def test_refining_both_cameras_together_is_worth_it():
    """The reason why intrinsics do not stay as each camera alone gives them."""
    truth = true_rig()
    errors = {}
    for seed in range(2):
        pairs = seen_pairs(truth, board_poses(truth, 20, seed), 0.1, seed)
        together = fit_rig(BOARD, pairs, SIZES)
        alone = tuple(Camera(name, *size, fit.K, fit.D) for name, size, fit in zip(NAMES, SIZES, (
            fit_camera(name, BOARD, {pair.name: getattr(pair, name) for pair in pairs}, size)
            for name, size in zip(NAMES, SIZES))))
        apart = fit_rig(BOARD, pairs, SIZES, alone)
        assert together.jointly and not apart.jointly
        for name, fit in (("together", together), ("apart", apart)):
            errors.setdefault(name, []).append(np.sqrt(np.mean(mapping_error(rig_of(fit), truth) ** 2)))
        told = together.deviations[2]
        assert errors["together"][-1] / 4 < told < 4 * errors["together"][-1]
    assert np.mean(errors["together"]) < 0.6 * np.mean(errors["apart"])


def warnings_of(poses):
    truth = true_rig()
    corners = {pair.name: pair.depth for pair in seen_pairs(truth, poses)}
    fit = fit_camera("depth", BOARD, corners, SIZES[0])
    return "\n".join(view_warnings("depth", fit, corners, SIZES[0]))


def test_boards_that_are_tilted_alike_or_leave_a_side_empty():
    spread = [[0.1 * (n % 5) - 0.2, 0.06 * (n % 4) - 0.1, 0.8 + 0.05 * n] for n in range(14)]
    alike = warnings_of([tilted(3 + 0.5 * (n % 3), 2, 5 * n, place) for n, place in enumerate(spread)])
    assert "% only: take more views, each tilted differently" in alike
    places = [[-0.22 + 0.01 * n, 0.04 * (n % 4) - 0.06, 0.9] for n in range(8)]
    left = warnings_of([tilted(30 * (-1) ** n, 25 * (-1) ** (n // 2), 5 * n, place) for n, place in enumerate(places)])
    assert "no board in the right" in left and "has 8 views of the board only" in left and "tilt" not in left


def test_the_infrared_picture_of_a_kinect_may_have_more_rows():
    assert depth_size((640, 488), True) == (640, 480) and depth_size((1280, 1024), True) == (1280, 1024)


def outline(x, y, width, height, lean=0.0):
    return np.array([[x, y], [x + width, y], [x + width + lean, y + height], [x + lean, y + height]], float)


def test_what_the_views_span():
    def view(*shape):
        return [measure(outline(*shape), (640, 480))] * 2

    def lacking():
        return [advice for advice, share in zip(ADVICE, spanned(views)) if share < 1]

    views = []
    assert len(lacking()) == 4
    views += [view(10, 10, 100, 80), view(520, 10, 100, 80)]
    assert spanned(views)[0] == 1 and lacking() == ["to the upper and lower border", "nearer", "tilted more"]
    views += [view(100, 380, 100, 80, 60), view(100, 50, 400, 300)]
    assert not lacking()


def test_a_view_is_taken_when_it_is_new_and_held_still(tmp_path):
    truth = true_rig()
    camera_rays = rays(truth.depth), rays(truth.color)
    poses = board_poses(truth, 3, seed=3)

    def pictures(pose, seed):
        return [render(one, seen, noise=2, seed=seed) for one, seen in
                zip(camera_rays, (pose, in_color_camera(truth, pose)))]

    view = LiveView(BOARD, 2, str(tmp_path))
    assert [view.add(pictures(poses[0], seed)) for seed in range(3)] == [False, True, False]
    assert "like one that is taken" in view.status()[1]
    assert not view.add(pictures(poses[1], 4)) and "hold it still" in view.status()[1]
    assert view.add(pictures(poses[1], 5)) and len(view.pairs) == 2 and not view.enough
    assert not view.add([np.full((480, 640), 90, np.uint8), pictures(poses[0], 0)[1]])
    assert "no board in the depth picture" in view.status()[1]
    assert view.picture().shape[0] > 360
    assert sorted(path.name for path in (tmp_path / "depth").iterdir()) == ["000.png", "001.png"]
    with pytest.raises(ValueError, match="holds pictures already"):
        LiveView(BOARD, 2, str(tmp_path))
    shutil.rmtree(tmp_path / "color")
    view.add(pictures(poses[2], 6))
    with pytest.raises(FileNotFoundError, match="color/002.png"):
        view.add(pictures(poses[2], 7))
    assert len(view.pairs) == 3 and view.picture().shape[0] > 360  # the pair counts


@pytest.mark.parametrize("place, why", [("file/rig", "Not a directory|File exists"), ("file", "is no folder"),
                                        ("gone/rig", "File exists|No such file")])
def test_where_nothing_can_be_written(tmp_path, place, why):
    """It is told before the work."""
    (tmp_path / "file").write_text("")
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    RigFolder(str(tmp_path / "rig")).discard()
    with pytest.raises(OSError, match=why):
        RigFolder(str(tmp_path / place))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "gone"]


def test_a_damaged_picture_is_told_with_its_topic(monkeypatch):
    said, damaged = [], Image(height=480, width=640, encoding="mono16", step=1280, data=b"short")
    monkeypatch.setattr(live.rospy, "logwarn_throttle", lambda _, line: said.append(line))
    live._look(None, [color_message(np.zeros((480, 640, 3), np.uint8), Header()), damaged], None)
    assert len(said) == 1 and said[0].startswith("/rgb/image: a picture cannot be used: data holds 5 bytes")


def test_how_far_a_board_moved_does_not_depend_on_the_order():
    corners = seen_pairs(true_rig(), board_poses(true_rig(), 1))[0].depth
    assert moved(BOARD, corners[::-1] + [3, 4], corners) == pytest.approx(5)
