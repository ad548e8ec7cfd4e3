# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags: what make_bag writes, what the player finds in one."""
import math
import os

import cv2
import numpy as np
import pytest
import rosbag
import yaml
from cv_bridge import CvBridge
from sensor_msgs.msg import Image

from all_in_focus.bag.bag_file import BagContents, BagError, Topics
from all_in_focus.bag.writer import stamp_of, write_bag
from all_in_focus.files.rig import Camera, Optics, Rig, load_rig, save_rig
from all_in_focus.files.stack import Stack
from bag_helpers import compressed, rewritten
from file_helpers import SIZE, call, cut, file_limit, focus_file, pictures, run_script, write_pages, write_stack
from tool_helpers import expect_refusal, succeeded

ROTATION = [0.0, 0.0, 0.6, 0.8]


@pytest.fixture
def rig(tmp_path):
    folder = tmp_path / "rig"
    color = Camera.pinhole("dslr", *SIZE, 60, 61, 24, 16)
    color.D = np.array([0.1, -0.2, 0.001, 0.002, 0.05])
    save_rig(str(folder), Rig(Camera.pinhole("kinect", 32, 24, 40, 41, 16, 12), color, np.eye(3), [0.01, -0.02, 0.03],
                              Optics(35.0, 2.8, 0.03), "color_frame", "depth_frame"))
    with open(folder / "extrinsics.yaml", "w", encoding="utf-8") as file:
        yaml.safe_dump({"parent_frame": "color_frame", "child_frame": "depth_frame",
                        "translation": [0.01, -0.02, 0.03], "rotation": ROTATION}, file)
    return folder


@pytest.fixture
def depth():
    return np.arange(32 * 24, dtype=np.uint16).reshape(24, 32) + 500


def messages(bag_path, topic):
    with rosbag.Bag(bag_path) as bag:
        return [(message, time) for _, message, time in bag.read_messages([topic])]


@pytest.fixture
def bag(tmp_path, rig, depth):
    frames = pictures(5)
    names = [f"{i}.png" for i in range(5)]
    focus = focus_file(tmp_path, "frames: [{file: 1.png, focus_mm: 1500}]")
    path = str(tmp_path / "x.bag")
    write_bag(path, depth, load_rig(rig), Stack(write_stack(tmp_path / "stack", names, frames), focus), rate=20.0)
    return path, frames


def test_bag_holds_the_bracket(bag, depth):
    path, frames = bag
    images = messages(path, "/rgb/image")
    assert len(images) == 5
    for index, ((image, when), (info, _), (focus, _)) in enumerate(
            zip(images, messages(path, "/rgb/camera_info"), messages(path, "/rgb/focus"))):
        assert image.header.stamp == when == focus.header.stamp == info.header.stamp == stamp_of(index, 20.0)
        assert image.header.frame_id == info.header.frame_id == focus.header.frame_id == "color_frame"
        assert np.array_equal(CvBridge().imgmsg_to_cv2(image), frames[index]) and image.encoding == "bgr8"
        assert (focus.bracket_id, focus.index, focus.count, focus.last) == (0, index, 5, index == 4)
        assert focus.focus_distance == 1.5 if index == 1 else math.isnan(focus.focus_distance)
        assert info.K == (60, 0, 24, 0, 61, 16, 0, 0, 1) and info.D == (0.1, -0.2, 0.001, 0.002, 0.05)
        assert (info.width, info.height, info.distortion_model) == (48, 32, "plumb_bob")
        assert info.P == (60, 0, 24, 0, 0, 61, 16, 0, 0, 0, 1, 0)
    (image, when), = messages(path, "/depth/image_raw")
    assert image.header.stamp == stamp_of(0, 20.0) and image.header.frame_id == "depth_frame"
    assert image.encoding == "16UC1" and np.array_equal(CvBridge().imgmsg_to_cv2(image), depth)
    with rosbag.Bag(path) as opened:
        topics = ["/rgb/image", "/depth/image_raw", "/depth/camera_info"]
        order = [topic for topic, _, _ in opened.read_messages(topics)]
        assert order[:3] == ["/depth/camera_info", "/depth/image_raw", "/rgb/image"]
        assert "lz4" in opened.get_compression_info().compression


def test_bag_has_latched_transform_and_optics(bag):
    path, _ = bag
    (tf, _), = messages(path, "/tf_static")
    transform, = tf.transforms
    rotation = transform.transform.rotation
    assert (transform.header.frame_id, transform.child_frame_id) == ("color_frame", "depth_frame")
    assert [rotation.x, rotation.y, rotation.z, rotation.w] == ROTATION
    assert transform.transform.translation.y == -0.02
    (optics, _), = messages(path, "/rgb/optics")
    assert (optics.focal_length_mm, optics.aperture, optics.circle_of_confusion_mm) == (35.0, 2.8, 0.03)
    with rosbag.Bag(path) as opened:
        latched = {connection.topic for connection in opened._get_connections()
                   if connection.header.get("latching") in ("1", b"1")}
    assert latched == {"/tf_static", "/rgb/optics"}


def test_equal_input_makes_equal_bags(tmp_path, bag, rig, depth):
    path, _ = bag
    again = str(tmp_path / "again.bag")
    write_bag(again, depth, load_rig(rig), Stack(str(tmp_path / "stack"), str(tmp_path / "focus.yaml")), rate=20.0)
    assert open(path, "rb").read() == open(again, "rb").read()


def test_make_bag_command(tmp_path, rig, depth):
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    folder = write_stack(tmp_path / "stack", ["0.png", "1.png"])
    arguments = ["--depth", tmp_path / "depth.png", "--rig", rig, "--stack", folder, "--output", tmp_path / "x.bag"]
    succeeded(run_script("make_bag", *arguments, "--no-focus"))
    assert len(messages(str(tmp_path / "x.bag"), "/rgb/image")) == 2
    assert not messages(str(tmp_path / "x.bag"), "/rgb/focus")

    before = (tmp_path / "x.bag").read_bytes()
    turned = write_stack(tmp_path / "turned", ["0.png"], pictures(1, SIZE[::-1]))
    cut(folder / "1.png")
    cv2.imwrite(str(tmp_path / "small.png"), depth[:10])
    for bad, complaint in (([], "1.png: truncated"), (["--depth", tmp_path / "small.png"], "depth.yaml says 32x24"),
                           (["--depth", tmp_path / "none.png"], "No such file"), (["--rig", tmp_path], "yaml"),
                           (["--stack", turned], "32x48 pixels, but color.yaml is of 48x32: not the same picture"),
                           (["--rate", "0"], "positive"), (["--output", tmp_path / "none" / "x.bag"], "No such file"),
                           (["--output", tmp_path], "is a folder")):
        expect_refusal(call("make_bag", *arguments, *bad), "make_bag", complaint)
    assert (tmp_path / "x.bag").read_bytes() == before
    assert not [name for name in os.listdir(tmp_path) if name.startswith(".")]


def test_sixteen_bits_go_into_a_bag_and_out_of_it(tmp_path, rig, depth):
    frames = [frame.astype(np.uint16) * 257 - 1 for frame in pictures(2)]
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    stack, bag = write_stack(tmp_path / "stack", ["0.png", "1.tif"], frames), str(tmp_path / "x.bag")
    call("make_bag", "--depth", tmp_path / "depth.png", "--rig", rig, "--stack", stack, "--output", bag)
    for path in (bag, rewritten(bag, str(tmp_path / "y.bag"),
                                lambda topic, message: topic != "/rgb/image" or (topic, compressed(message, 0)))):
        images = [message for kind, message, _ in BagContents(path).messages() if kind == "rgb"]
        assert [image.encoding for image in images] == ["bgr16", "bgr16"]
        assert np.array_equal([CvBridge().imgmsg_to_cv2(image) for image in images], frames)

    cv2.imwrite(str(tmp_path / "stack" / "1.tif"), frames[1].astype(np.float32))
    expect_refusal(call("make_bag", "--depth", tmp_path / "depth.png", "--rig", rig, "--stack", stack, "--output", bag),
                   "make_bag", "1.tif: has float32 pixels, which only fuse_stack reads: save it with 8 or 16 bits")


def test_pages_of_a_tiff_go_into_a_bag(tmp_path, rig, depth):
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    frames = pictures(3)
    stack = write_pages(tmp_path / "stack.tif", frames)
    call("make_bag", "--depth", tmp_path / "depth.png", "--rig", rig, "--stack", stack, "--output", tmp_path / "x.bag")
    images = [CvBridge().imgmsg_to_cv2(image) for image, _ in messages(str(tmp_path / "x.bag"), "/rgb/image")]
    assert np.array_equal(images, frames)


def test_make_bag_on_a_full_disk(tmp_path, rig, depth):
    """One line that names the bag, although the rig, having no lens, would get a warning."""
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    folder = write_stack(tmp_path / "stack", [f"{index:02d}.png" for index in range(20)])
    (rig / "optics.yaml").unlink()
    before = sorted(os.listdir(tmp_path))
    done = run_script("make_bag", "--depth", tmp_path / "depth.png", "--rig", rig, "--stack", folder, "--output",
                      tmp_path / "x.bag", preexec_fn=file_limit(20))
    assert (done.returncode, done.stderr) == (2, f"make_bag: {tmp_path / 'x.bag'}: File too large\n")
    assert sorted(os.listdir(tmp_path)) == before


def test_make_scene_on_a_full_disk(tmp_path):
    """One line, without one of the PNG library's."""
    done = run_script("make_scene", "--scene", "planes", "--size", "160x120", "--frames", 2, "--output", tmp_path / "scene",
                      preexec_fn=file_limit(5))
    assert done.returncode == 2
    assert done.stderr.startswith(f"make_scene: {tmp_path / 'scene'}") and done.stderr.endswith(": File too large\n")
    assert done.stderr.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_contents_of_a_good_bag(bag):
    contents = BagContents(bag[0])
    assert contents.counts == {"depth": 1, "depth_info": 1, "rgb": 5, "rgb_info": 5, "focus": 5, "optics": 1}
    assert contents.start == stamp_of(0, 20.0) and contents.optics.aperture == 2.8
    assert len(contents.static_transforms.transforms) == 1
    kinds = [kind for kind, _, _ in contents.messages()]
    assert kinds.index("depth") < kinds.index("rgb") and kinds.count("rgb") == 5


@pytest.mark.parametrize("missing, complaint", [
    ("/depth/image_raw", "no depth image: nothing on /depth/image_raw .there are /rgb/image"),
    ("/depth/camera_info", "no camera info of the depth camera"), ("/rgb/camera_info", "no camera info of the colour"),
    ("/rgb/image", "no colour image: nothing on /rgb/image"), ("/tf_static", "no transform")])
def test_bag_without_something_needed(tmp_path, bag, missing, complaint):
    path = rewritten(bag[0], str(tmp_path / "y.bag"), lambda topic, _: topic != missing)
    with pytest.raises(BagError, match=complaint):
        BagContents(path)


def test_bag_without_the_optional(tmp_path, bag):
    path = rewritten(bag[0], str(tmp_path / "y.bag"), lambda topic, _: topic not in ("/rgb/optics", "/rgb/focus"))
    contents = BagContents(path)
    assert contents.optics is None and "focus" not in contents.counts


def test_transforms_must_connect_the_cameras(tmp_path, bag):
    def elsewhere(topic, message):
        if topic == "/tf_static":
            message.transforms[0].child_frame_id = "other"

    with pytest.raises(BagError, match="'depth_frame' with colour frame 'color_frame'"):
        BagContents(rewritten(bag[0], str(tmp_path / "y.bag"), elsewhere))
    moving = rewritten(bag[0], str(tmp_path / "z.bag"), lambda topic, m: topic != "/tf_static" or ("/tf", m))
    assert [kind for kind, _, _ in BagContents(moving).messages()].count("tf") == 1


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of cv_bridge
def test_other_topic_names_and_compressed_color(tmp_path, bag):
    names = {"/depth/image_raw": "/kinect/depth", "/rgb/image": "/dslr/image/compressed"}

    def renamed(topic, message):
        return names.get(topic, topic), compressed(message, 0) if topic == "/rgb/image" else message

    path = rewritten(bag[0], str(tmp_path / "y.bag"), renamed)
    contents = BagContents(path, Topics(depth="kinect/depth", rgb="/dslr/image"))
    images = [message for kind, message, _ in contents.messages() if kind == "rgb"]
    assert len(images) == 5 and all(image._type == Image._type and image.encoding == "bgr8" for image in images)
    assert np.array_equal(CvBridge().imgmsg_to_cv2(images[3]), bag[1][3])
    assert images[3].header.stamp == stamp_of(3, 20.0)

    def broken(topic, message):
        if topic.endswith("compressed") and message.header.stamp == stamp_of(2, 20.0):
            message.data = b"nonsense"

    contents = BagContents(rewritten(path, str(tmp_path / "z.bag"), broken), Topics("/kinect/depth", rgb="/dslr/image"))
    assert [kind for kind, _, _ in contents.messages()].count("rgb") == 4
    assert len(contents.problems) == 1 and "cannot be decoded" in contents.problems[0]


def test_wrong_type_is_named(bag):
    with pytest.raises(BagError, match="/rgb/camera_info holds sensor_msgs/CameraInfo, not sensor_msgs/Image"):
        BagContents(bag[0], Topics(depth="/rgb/camera_info"))


def test_unreadable_bags_are_named(tmp_path, bag):
    (tmp_path / "text.bag").write_text("not a bag at all")
    (tmp_path / "empty.bag").write_bytes(b"")
    cut(bag[0])
    for path, complaint in ((tmp_path / "none.bag", "No such file"), (tmp_path / "text.bag", "not a bag"),
                            (tmp_path / "empty.bag", "not a bag"), (tmp_path, "is a folder"), (bag[0], "no index")):
        with pytest.raises(BagError, match=complaint) as error:
            BagContents(str(path))
        assert "\n" not in str(error.value)
