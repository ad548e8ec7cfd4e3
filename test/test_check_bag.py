# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""check_bag: each damage to a good bag is found, under the right name, and nothing else is an error."""
import json
import os
import re
from dataclasses import replace

import cv2
import genpy
import numpy as np
import pytest
import rosbag
from bag_helpers import (BRIDGE, COLOR_CAMERA, SIZE, START, changed, compressed, depth_image, frames, good_messages, setting,
                         without, write)
from file_helpers import call, cut, run, run_script
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header
from tool_helpers import TwoPlanes, expect_refusal, fuse_stack, set_up_boards, succeeded, unchanged

from all_in_focus.bag.brackets import Rules
from all_in_focus.bag.bag_file import BagContents, BagError, BagFile, Topics, load_topics
from all_in_focus.bag.check.checker import check_bag
from all_in_focus.image_messages import to_message
from all_in_focus.files.rig import load_rig, save_rig
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.replay.launch import own_master

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of cv_bridge
CHECKS = ["file", "topics", "depth image", "colour image", "depth camera", "colour camera", "transform", "stamps",
          "brackets", "depth in time", "depth values", "overlap", "optics", "focus steps", "exposure", "focus change"]


def report_on(path, topics=None, **options):
    bag = BagFile(str(path), topics)
    try:
        return check_bag(bag, options.pop("rules", Rules()), **options)
    finally:
        bag.close()


def depth(values, encoding="16UC1"):
    def change(message, _):
        return to_message(values.astype(np.float32 if encoding == "32FC1" else np.uint16), encoding, message.header)
    return changed("/depth/image_raw", change)


def later(prefix, seconds):
    """Stamps, not times of recording."""
    def change(message, _):
        message.header.stamp = genpy.Time.from_sec(message.header.stamp.to_sec() + seconds) if seconds else genpy.Time()
    return changed(prefix, change)


def transform(**values):
    """x: of the translation, w, y: of the rotation, child: frame."""
    def change(message, _):
        one = message.transforms[0]
        one.child_frame_id = values.get("child", one.child_frame_id)
        one.transform.translation.x = values.get("x", one.transform.translation.x)
        for name in {"w", "y"} & set(values):
            setattr(one.transform.rotation, name, values[name])
    return changed("/tf_static", change)


def frame_id(topic, name):
    return changed(topic, lambda message, _: setattr(message.header, "frame_id", name))


def focus(distances):
    return changed("/rgb/focus", lambda message, number: setattr(message, "focus_distance", distances[number]))


def brighter(message, number):
    if number == 2:
        message.data = np.minimum(255, np.frombuffer(message.data, np.uint8) * 1.1).astype(np.uint8).tobytes()


def bayer(message, _):
    return to_message(BRIDGE.imgmsg_to_cv2(message)[..., 0].copy(), "bayer_rggb8", message.header)


def noisy_copies(messages):
    """Every frame is the first, with noise of its own."""
    images = [entry[1] for entry in messages if entry[0] == "/rgb/image"]
    random, data = np.random.default_rng(0), np.frombuffer(images[0].data, np.uint8)
    for image in images:
        image.data = np.clip(np.rint(data + random.normal(0, 2, len(data))), 0, 255).astype(np.uint8).tobytes()


def copies(messages):
    images = [entry[1] for entry in messages if entry[0] == "/rgb/image"]
    images[2].data = images[1].data


def moved(messages, topic, to):
    return [[to if entry[0] == topic else entry[0], *entry[1:]] for entry in messages]


def late_transform(messages):
    messages[0] = ["/tf", messages[0][1], START + 0.15]


def swapped(messages):
    for topic in ("/rgb/image", "/rgb/focus"):
        one, other = [entry[1].header for entry in messages if entry[0] == topic][1:3]
        one.stamp, other.stamp = other.stamp, one.stamp


ERRORS = {
    "no depth": (without("/depth/image_raw"), "topics", "no depth image: nothing on /depth/image_raw$"),
    "no colour": (without("/rgb/image"), "topics", "no colour image: nothing on /rgb/image$"),
    "no depth info": (without("/depth/camera_info"), "topics", "no camera info of the depth camera"),
    "no colour info": (without("/rgb/camera_info"), "topics", "no camera info of the colour camera"),
    "renamed": (lambda m: moved(m, "/depth/image_raw", "/camera/depth/image_raw"), "topics",
                "nothing on /depth/image_raw; of that type there is /camera/depth/image_raw: "
                "--depth-topic /camera/depth/image_raw$"),
    "renamed info": (lambda m: moved(m, "/rgb/camera_info", "/dslr/camera_info"), "topics",
                     "/dslr/camera_info: --rgb-info-topic /dslr/camera_info$"),
    "compressed depth": (lambda m: moved(changed("/depth/image_raw", compressed)(m), "/depth/image_raw",
                                         "/depth/image_raw/compressedDepth"), "topics",
                         "compressedDepth cannot be read: rosrun image_transport republish compressedDepth in:="),
    "wrong type": (lambda m: moved(without("/depth/image_raw")(m), "/depth/camera_info", "/depth/image_raw"), "topics",
                   "/depth/image_raw holds sensor_msgs/CameraInfo, not sensor_msgs/Image"),
    "two types": (lambda m: m + moved([entry for entry in m if entry[0] == "/depth/camera_info"], "/depth/camera_info",
                                      "depth/image_raw"), "topics",  # without "/": rosbag then writes a connection of its own
                  "holds sensor_msgs/CameraInfo and sensor_msgs/Image, not sensor_msgs/Image.*of one publisher"),
    "depth encoding": (setting("/depth/image_raw", encoding="mono8"), "depth image", "\"mono8\": publish 16UC1"),
    "byte order": (setting("/depth/image_raw", is_bigendian=1), "depth image", "byte order"),
    "colour encoding": (setting("/rgb/image", encoding="8UC3"), "colour image", "8UC3.*publish bgr8 or rgb8"),
    "colour unknown": (setting("/rgb/image", encoding="nv21"), "colour image", "nv21.*publish bgr8 or rgb8"),
    "short": (changed("/rgb/image", lambda message, _: setattr(message, "data", message.data[:-5])), "colour image",
              "data holds 9211 bytes, but 64x48 bgr8 with step 192 needs 9216"),
    "step": (setting("/depth/image_raw", step=100), "depth image", "step is 100 bytes, but a row of 64 16UC1"),
    "depth info size": (setting("/depth/camera_info", width=128, height=96), "depth camera",
                        "is for 128x96, the images have 64x48"),
    "colour info shape": (setting("/rgb/camera_info", width=128, height=72), "colour camera",
                          "is for 128x72, the images have 64x48.*of another shape are refused"),
    "uncalibrated": (setting("/rgb/camera_info", K=[0.0] * 9), "colour camera", "not calibrated .fx = 0"),
    "model": (setting("/rgb/camera_info", distortion_model="omni"), "colour camera", "\"omni\" is not supported"),
    "skew": (setting("/rgb/camera_info", K=[60.0, 2, 31.5, 0, 60, 23.5, 0, 0, 1]), "colour camera", "has a skew, 2"),
    "no frame": (frame_id("/depth/image_raw", ""), "depth camera", "/depth/image_raw: frame_id is empty"),
    "no tf": (without("/tf_static"), "transform", "nothing on /tf_static or /tf: record them too"),
    "tf elsewhere": (transform(child="other"), "transform", "depth frame 'depth' with colour frame 'color'"),
    "tf impossible": (transform(w=0.0), "transform", "no transform connects"),
    "tf in mm": (transform(x=30.0), "overlap", "no depth falls into the colour picture"),
    "tf turned round": (transform(w=0.0, y=1.0), "overlap", "no depth falls"),
    "all stamps": (later("/", 0), "stamps", "/rgb/image: 4 of 4 stamps are zero"),
    "depth stamps": (later("/depth/", 0), "stamps", "/depth/image_raw: 1 of 1 stamps are zero"),
    "clocks": (later("/rgb/", 3612), "stamps", "colour is stamped 1:00:12 later than depth.*chrony"),
    "depth too late": (later("/depth/", 0.2), "depth in time",
                       "bracket 0: no depth .*the first depth comes 0.2 s too late"),
    "focus stamps": (later("/rgb/focus", 0.01), "brackets", "no colour image has a message of the same stamp"),
    "no beginning": (changed("/rgb/focus", lambda message, _: setattr(message, "index", message.index + 1)), "brackets",
                     "no bracket has its beginning"),
    "no reading": (depth(np.zeros(SIZE[::-1])), "depth values", "not one pixel has a depth"),
    "mm in 32FC1": (depth(depth_image(), "32FC1"), "depth values", "above 1500: mm, but 32FC1 means m"),
    "lens longer than the scene": (setting("/rgb/optics", focal_length_mm=2400.0), "optics", "not below the nearest depth"),
}

WARNINGS = {
    "lens in micrometres": (setting("/rgb/optics", focal_length_mm=24000.0), "optics", "impossible .f = 24000"),
    "bayer": (changed("/rgb/image", bayer), "colour image", "bayer_rggb8 is interpolated by the simplest method"),
    "one bad frame": (changed("/rgb/image", lambda message, number: number == 2 and setattr(message, "encoding", "x")),
                      "colour image", "1 of 4 images, the first at 0.200 s: .*bgr8"),
    "sizes": (changed("/rgb/image", lambda message, number: number == 1 and setattr(message, "height", 24)),
              "colour image", "sizes differ .64x48: 3, 64x24: 1"),
    "colour info size": (setting("/rgb/camera_info", width=128, height=96), "colour camera", "is for 128x96"),
    "frames differ": (frame_id("/rgb/image", "lens"), "colour camera", "says frame 'color', the images 'lens'"),
    "rectified": (setting("/rgb/camera_info", P=[70.0, 0, 31.5, 0, 0, 70.0, 23.5, 0, 0, 0, 1, 0]), "colour camera",
                  "as of rectified images"),
    "tf late": (late_transform, "transform", "recorded after the first depth image"),
    "no calibration of the pose": (transform(x=0.0), "transform", "at one place"),
    "stamps go back": (swapped, "stamps", "stamps go back 1 time, by up to 0.100 s"),
    "recorded again": (later("/", -3600), "stamps", "recorded 1:00:00 after their stamps"),
    "frames without focus": (changed("/rgb/focus", lambda message, number: number == 2 and setattr(
        message.header, "stamp", genpy.Time(1))), "brackets", "1 of 4 colour images have no message of the same stamp"),
    "frame missing": (lambda m: [entry for entry in m if entry[2] != START + 0.2], "brackets",
                      "1 of 4 frames are missing, the first is 2"),
    "first picture missing": (lambda m: [entry for entry in m if entry[::2] != ["/rgb/image", START]], "brackets",
                              "1 of 4 frames are missing, the first is 0"),
    "counts": (changed("/rgb/focus", lambda message, number: setattr(message, "count", 4 + number % 2)), "brackets",
               "count is 4 and 5"),
    "raw Kinect": (depth(np.where(np.arange(SIZE[0]) < 20, 2047, depth_image())), "depth values",
                   r"31 % .* 2047 mm.*--invalid-values \[0,2047,65535\]"),
    "little depth": (depth(np.pad(depth_image()[:12, 31:34], ((0, SIZE[1] - 12), (31, SIZE[0] - 34)))), "overlap",
                     "only [1-4].* % of the colour picture gets a depth: check the transform and both calibrations"),
    "binned": (setting("/rgb/camera_info", K=[240.0, 0, 31.5, 0, 240, 23.5, 0, 0, 1], width=256, height=192, binning_x=4,
                       binning_y=4), "transform",
               "principal point of the colour camera, 7.5, 5.5, is not in the middle half of its 64x48 pictures.*binning"),
    "circle of confusion": (setting("/rgb/optics", circle_of_confusion_mm=1.9), "optics",
                            "the circle of confusion, 1.9 mm, is over a fiftieth of the sensor"),
    "no lens": (without("/rgb/optics"), "optics", "nothing on /rgb/optics.*--optics f,F,coc"),
    "impossible lens": (setting("/rgb/optics", aperture=0.0), "optics", "impossible .f = 24 mm, F = 0"),
    "no distances": (setting("/rgb/focus", focus_distance=float("nan")), "focus steps", "no focus distances are known"),
    "one distance": (focus([1.3] * 4), "focus steps", "3 of 3 steps leave the focus distance as it is"),
    "to and fro": (focus([1, 1.5, 1.2, 2]), "focus steps", "to and fro"),
    "nothing near": (focus([2, 3, 4, 5]), "focus steps", "nothing is sharp between 1 and 1.58 m, where 50 %"),
    "exposure": (changed("/rgb/image", brighter), "exposure", "the light changes by 2. %, most in frame 2"),
    "focus stands": (noisy_copies, "focus change", "all frames are equally sharp"),
    "a frame twice": (copies, "focus change", "1 frame with exactly the pixels of the frame before"),
}


@pytest.mark.parametrize("name", [*ERRORS, *WARNINGS])
def test_damage_is_found(tmp_path, name):
    damage, check, text = {**ERRORS, **WARNINGS}[name]
    messages = good_messages()
    report = report_on(write(tmp_path / "x.bag", damage(messages) or messages))
    found = "\n".join(report.lines())
    level = "error" if name in ERRORS else "warning"
    lines = [finding.text for finding in report.findings if (finding.check, finding.level) == (check, level)]
    assert any(re.search(text, line) for line in lines), found
    assert report.fusable == (name in WARNINGS), found
    assert not any("\n" in line for line in lines)


def test_a_good_bag(tmp_path):
    path = write(tmp_path / "x.bag", good_messages(brackets=2))
    report = report_on(path)
    assert [(finding.check, finding.level) for finding in report.findings] == [(check, "ok") for check in CHECKS]
    assert report.brackets == [{"bracket_id": number, "frames": 4, "depth": True} for number in range(2)]
    done = succeeded(run_script("check_bag", path, "--json", tmp_path / "r.json"))
    assert done.stdout.splitlines() == [*report.lines(), f"{path}: can be fused"] and done.stderr == ""
    assert json.loads((tmp_path / "r.json").read_text()) == report.plain()


def test_a_warning_after_an_error_hides_no_error(tmp_path):
    messages = setting("/rgb/camera_info", K=[200.0, 0, 31.5, 0, 200, 23.5, 0, 0, 1])(good_messages())
    lens = setting("/rgb/optics", focal_length_mm=1100.0, circle_of_confusion_mm=9.9)
    report = report_on(write(tmp_path / "x.bag", lens(messages)))
    assert [finding.level for finding in report.findings if finding.check == "optics"] == ["error", "warning"]
    assert report.skipped == ["focus steps"]


def test_the_rig_is_checked_in_the_words_of_fuse_stack(tmp_path):
    """What fuse_stack warns of is what check_bag says of the same files in a bag."""
    planes, bag = TwoPlanes(tmp_path), tmp_path / "x.bag"
    words = set()
    for turn, translation, quaternion in ((1, [0, 0, -2.5], [0, 0, 0, 1]), (1, [0, 0, 0], [0, 0.4579, 0, 0.8890]),
                                          (1, [0, 0, 0.4], [0, 0.5225, 0, 0.8526]), (-1, [0, 0, 0], [0, 0, 0, 1])):
        set_up_boards(planes, turn)
        rig = load_rig(planes.rig)
        rig.t, rig.quaternion = np.array(translation, float), quaternion
        save_rig(planes.rig, rig)
        done = succeeded(fuse_stack("--stack", planes.stack, *planes.with_depth, "--output", planes.output("o.png")))
        said = {line.partition("warning: ")[2] for line in done.stderr.splitlines() if "warning: " in line}
        succeeded(call("make_bag", "--depth", planes.depth_file, "--rig", planes.rig, "--stack", planes.stack,
                       "--output", bag))
        found = {finding.text for finding in report_on(bag).findings
                 if finding.level == "warning" and finding.check in ("transform", "overlap")}
        assert said and said <= found, (said, found)
        assert found - said <= {"both cameras stand at one place: was the rig calibrated?"}
        words |= {line[-40:] for line in said}
    assert len(words) == 4


def test_metres_in_an_image_of_millimetres(tmp_path):
    report = report_on(write(tmp_path / "x.bag", depth(np.rint(depth_image() / 1000))(good_messages())))
    assert any(finding.check == "depth values" and "m, but a depth image means mm" in finding.text
               for finding in report.findings), report.lines()


def test_depth_of_some_brackets_only(tmp_path):
    messages = good_messages(brackets=3)
    messages = [entry for entry in messages if entry[0] != "/depth/image_raw" or entry[2] != START + 10]
    report = report_on(write(tmp_path / "x.bag", messages))
    assert report.fusable and [bracket["depth"] for bracket in report.brackets] == [True, False, True]
    line, = [finding.text for finding in report.findings if finding.level == "warning"]
    assert line.startswith("1 of 3 brackets, such as bracket 1: no depth") and "newest before it is 10 s old" in line


def test_without_focus_messages_gaps_end_brackets(tmp_path):
    path = write(tmp_path / "x.bag", without("/rgb/focus")(good_messages(brackets=2)))
    assert [bracket["frames"] for bracket in report_on(path).brackets] == [4, 4]
    assert [bracket["frames"] for bracket in report_on(path, rules=Rules(size=2)).brackets] == [2] * 4
    report = report_on(path, rules=Rules(gap=0.05))
    assert any("all brackets are of one frame only" in finding.text for finding in report.findings)


def test_float_depth_padding_and_compressed_color(tmp_path):
    messages = good_messages()
    messages = depth(depth_image() / 1000, "32FC1")(messages) or messages
    messages = moved(changed("/rgb/image", compressed)(messages) or messages, "/rgb/image", "/rgb/image/compressed")
    report = report_on(write(tmp_path / "x.bag", messages))
    assert report.fusable and "compressed colour" in report.findings[1].text
    assert "1.00 to 2.00 m" in "\n".join(report.lines())


def as_compressed(convert, ending=".jpg", broken=lambda number, data: data):
    def change(message, number):
        data = cv2.imencode(ending, convert(BRIDGE.imgmsg_to_cv2(message)))[1].tobytes()
        return CompressedImage(message.header, "bgr8; compressed bgr8", broken(number, data))
    return lambda messages: moved(changed("/rgb/image", change)(messages), "/rgb/image", "/rgb/image/compressed")


def gray(picture):
    return cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)


COMPRESSED = {
    "gray JPEG": (as_compressed(gray), lambda picture: np.dstack([gray(picture)] * 3), 25),
    "gray 16-bit PNG": (as_compressed(lambda picture: gray(picture).astype(np.uint16) * 257, ".png"),
                        lambda picture: np.dstack([gray(picture)] * 3).astype(np.uint16) * 257, 0),
    "16-bit PNG": (as_compressed(lambda picture: picture.astype(np.uint16) * 257, ".png"),
                   lambda picture: picture.astype(np.uint16) * 257, 0),
    "12 bits in 16": (as_compressed(lambda picture: picture.astype(np.uint16) * 16, ".png"),
                      lambda picture: picture.astype(np.uint16) * 16, 0),
    "PNG with alpha": (as_compressed(lambda picture: cv2.cvtColor(picture, cv2.COLOR_BGR2BGRA), ".png"), np.array, 0),
}


@pytest.mark.parametrize("kind", COMPRESSED)
def test_compressed_color_of_every_kind(tmp_path, kind):
    """check_bag, bag_to_stack and the player of evaluate_bag read it alike."""
    damage, expected, tolerance = COMPRESSED[kind]
    path = write(tmp_path / "x.bag", damage(good_messages()))
    report = report_on(path)
    assert report.fusable and not [finding for finding in report.findings if finding.level == "warning"], report.lines()
    succeeded(call("bag_to_stack", path, "--output", tmp_path / "out"))
    bag = BagContents(path)
    played = [BRIDGE.imgmsg_to_cv2(message) for kind, message, _ in bag.messages() if kind == "rgb"]
    bag.close()
    for number, picture in enumerate(frames()):
        exported = cv2.imread(str(tmp_path / "out" / "stack" / f"{number:03d}.png"), cv2.IMREAD_UNCHANGED)
        wanted = expected(picture)
        assert exported.dtype == wanted.dtype and np.array_equal(exported, played[number])
        assert np.abs(exported.astype(int) - wanted).max() <= tolerance


def test_compressed_floats_are_refused(tmp_path):
    """Their codes 0 to 1 would be black."""
    damage = as_compressed(lambda picture: picture.astype(np.float32) / 255, ".tiff")
    path = write(tmp_path / "x.bag", damage(good_messages()))
    report = report_on(path)
    assert not report.fusable and "the compressed picture has float32 pixels" in "\n".join(report.lines())
    expect_refusal(call("bag_to_stack", path, "--output", tmp_path / "out"), "bag_to_stack", "float32 pixels")


DAMAGES = {"cut by 5 percent": lambda data: data[:len(data) * 95 // 100],
           "cut to a third": lambda data: data[:len(data) // 3],
           "zeros at the end": lambda data: data[:len(data) // 3] + bytes(len(data) - len(data) // 3)}


@pytest.mark.parametrize("kind", DAMAGES)
@pytest.mark.parametrize("ending", [".jpg", ".png"])
def test_every_compressed_frame_is_looked_at(tmp_path, kind, ending):
    damage = as_compressed(np.array, ending, lambda number, data: DAMAGES[kind](data) if number == 2 else data)
    path = write(tmp_path / "x.bag", damage(good_messages()))
    report = report_on(path)
    line, = [finding.text for finding in report.findings if (finding.check, finding.level) == ("colour image", "warning")]
    assert report.fusable and "1 of 4 images, the first at 0.200 s: the compressed picture is cut short" in line
    done = succeeded(call("bag_to_stack", path, "--output", tmp_path / "out"))
    assert "frame 2 left out: the compressed picture is cut short" in done.stderr
    bag = BagContents(path)
    assert sum(kind == "rgb" for kind, *_ in bag.messages()) == 3 and "cut short" in bag.problems[0]
    bag.close()


def test_a_first_compressed_frame_that_is_broken_says_nothing_of_the_others(tmp_path):
    damage = as_compressed(np.array, broken=lambda number, data: data[:60] if number == 0 else data)
    report = report_on(write(tmp_path / "x.bag", damage(good_messages())))
    assert any("1 of 4 images, the first at 0.000 s" in finding.text for finding in report.findings), report.lines()
    assert "can be fused" in report.summary()


def test_messages_that_are_not_stored_in_the_order_of_their_times(tmp_path):
    """As recorders store them that buffer each topic for itself."""
    straight, turned = str(tmp_path / "straight.bag"), str(tmp_path / "turned.bag")
    messages = good_messages()
    write(straight, messages)
    with rosbag.Bag(turned, "w", chunk_threshold=1) as bag:
        for topic, message, when in reversed(messages):
            bag.write(topic, message, genpy.Time.from_sec(when))
    lines = [report_on(path).lines()[1:] for path in (straight, turned)]
    assert lines[0] == lines[1]
    for path in (straight, turned):
        succeeded(call("bag_to_stack", path, "--output", tmp_path / "out", "--force"))
        assert len(list((tmp_path / "out" / "stack").glob("*.png"))) == 4
        bag = BagContents(path)
        times = [time for _, _, time in bag.messages()]
        bag.close()
        assert times == sorted(times) and len(times) == 15


def test_options(tmp_path):
    messages = moved(good_messages(), "/depth/image_raw", "/kinect/depth")
    path = write(tmp_path / "x.bag", without("/rgb/optics")(messages))
    assert report_on(path, Topics(depth="kinect/depth")).fusable
    done = call("check_bag", path)
    assert done.returncode == 1 and "--depth-topic /kinect/depth" in done.stdout and done.stderr == ""
    done = succeeded(call("check_bag", path, "--depth-topic", "/kinect/depth", "--optics", "24,4,0.019"))
    assert done.stderr == "" and "warning" not in done.stdout


def test_bad_input_is_one_line(tmp_path):
    path = write(tmp_path / "x.bag", good_messages())
    (tmp_path / "text.bag").write_text("not a bag")
    (tmp_path / "picture.bag").write_bytes(b"\x89PNG\r\n\x1a\n")
    (tmp_path / "cut.bag").write_bytes((tmp_path / "x.bag").read_bytes())
    cut(tmp_path / "cut.bag")
    with unchanged(tmp_path):
        for arguments, complaint in (([tmp_path / "none.bag"], "No such file"), ([tmp_path / "text.bag"], "not a bag"),
                                     ([tmp_path / "picture.bag"], "picture.bag: not a bag of ROS 1\n"),
                                     ([tmp_path / "cut.bag"], "rosbag reindex"), ([tmp_path], "is a folder"),
                                     ([path, "--invalid-values", "many"], "list of whole numbers"),
                                     ([path, "--json", tmp_path / "none" / "r.json"], "No such file")):
            expect_refusal(call("check_bag", *arguments), "check_bag", complaint)


def test_what_is_no_image(tmp_path):
    """The connection says Image, the bytes do not."""
    messages = good_messages()
    path = str(tmp_path / "x.bag")
    with rosbag.Bag(path, "w") as bag:
        for topic, message, when in messages:
            if topic == "/depth/image_raw":
                raw = (message._type, b"too short", message._md5sum, type(message))
                bag.write(topic, raw, genpy.Time.from_sec(when), raw=True)
            else:
                bag.write(topic, message, genpy.Time.from_sec(when))
    report = report_on(path)
    assert not report.fusable and "no image can be read" in "\n".join(report.lines())


def test_a_bag_of_nothing(tmp_path):
    report = report_on(write(tmp_path / "x.bag", []))
    assert [finding.level for finding in report.findings if finding.check == "topics"] == ["error"] * 4


def test_damage_inside_a_bag(tmp_path):
    path = write(tmp_path / "x.bag", good_messages(), compression="bz2")
    data = bytearray((tmp_path / "x.bag").read_bytes())
    data[6000:6400] = bytes(400)
    (tmp_path / "x.bag").write_bytes(data)
    with pytest.raises(BagError, match="damaged or unreadable"):
        report_on(path)


def test_a_calibration_that_was_announced_for_another_size(tmp_path):
    def said_of(first):
        announced = ["/rgb/camera_info", camera_info(first, Header(frame_id="color")), START]
        report = report_on(write(tmp_path / "x.bag", [announced] + good_messages()))
        return [finding.text for finding in report.findings if finding.check == "colour camera" and finding.level != "ok"]
    assert not said_of(COLOR_CAMERA.scaled(128, 96))
    assert "changes 1 time:" in said_of(replace(COLOR_CAMERA, K=COLOR_CAMERA.K * [[1.2], [1.2], [1]]))[0]


def test_the_nodes_agree(tmp_path):
    """They refuse what cannot be fused with depth. The good bag is fused in test_evaluate_launch_takes_the_names_of_topics_..."""
    messages = good_messages()
    ERRORS["depth too late"][0](messages)
    bag = write(tmp_path / "late.bag", messages)
    done = run_script("evaluate_bag", "--bag", bag, "--output", tmp_path / "late")
    assert done.returncode == 2 and "no region came of the bag's depth" in done.stderr


def test_topics_that_are_proposed_are_written_and_read_again(tmp_path):
    path, names = tmp_path / "x.bag", tmp_path / "topics.yaml"
    messages = moved(good_messages(), "/depth/image_raw", "/camera/depth/image_raw")
    write(path, moved(messages, "/depth/camera_info", "/camera/depth/camera_info"))
    assert call("check_bag", path, "--save-topics", names).returncode == 1
    assert load_topics(str(names)) == Topics(depth="/camera/depth/image_raw", depth_info="/camera/depth/camera_info")
    assert call("check_bag", path, "--topics", names).returncode == 0
    done = call("check_bag", path, "--topics", names, "--depth-topic", "/other")
    assert done.returncode == 1 and "nothing on /other" in done.stdout
    names.write_text("depth: /camera/depth/image_raw\n")
    expect_refusal(call("check_bag", path, "--topics", names), "check_bag")


def test_evaluate_launch_takes_the_names_of_topics_from_a_file(tmp_path):
    bag, names = tmp_path / "x.bag", tmp_path / "topics.yaml"
    write(bag, moved(good_messages(), "/rgb/image", "/dslr/image"))
    names.write_text("rgb_topic: /dslr/image\n")
    done = run(["roslaunch", "all_in_focus", "evaluate.launch", "bag:=x.bag", "output:=out", "topics:=topics.yaml"],
               cwd=str(tmp_path), env=dict(os.environ, PWD=str(tmp_path), **own_master(tmp_path / "log")))
    assert "1 bracket fused" in done.stdout, done.stderr
    report = json.loads((tmp_path / "out" / "bracket_0000" / "report.json").read_text())
    assert report["has_labels"] and report["frames_used"] == 4
