# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All checks of a bag, in the order in which a person would repair what they find."""
from functools import partial

import numpy as np

from all_in_focus.bag.brackets import assemble
from all_in_focus.bag.check.cameras import check_camera, check_overlap, check_transform, rig_warnings
from all_in_focus.bag.check.findings import ERROR, BagReport, Check
from all_in_focus.bag.check.pixels import (BRACKETS, FRAMES, Sample, check_depth_values, check_exposure,
                                           check_focus_change, check_images, sample)
from all_in_focus.bag.check.recording import TITLES, check_depth_in_time, check_file, check_stamps, check_topics
from all_in_focus.bag.check.sweeps import check_brackets, check_focus_steps, check_optics
from all_in_focus.bag.recorded_rig import camera_at, color_frame, depth_problem, optics_at
from all_in_focus.bag.scan import scan
from all_in_focus.files.rig import Rig, RigError
from all_in_focus.image_messages import ImageError, bgr, depth_mm

DEPTH_SAMPLES = 3


def check_bag(bag, rules, invalid_values=(0,), optics=None):
    """BagReport of a BagFile. rules: of brackets; invalid_values: mm that mean unknown; optics: instead of the bag's.

    Raises BagError where it cannot be read to its end.
    """
    report, found = BagReport(bag.path), scan(bag, pixels=True)
    check = partial(Check, report)
    check_file(check("file"), bag)
    check_topics(check("topics"), bag, found)
    good = {kind: check_images(check(f"{title} image"), bag, found, kind) if found.counts.get(kind) else []
            for kind, title in TITLES.items()}
    cameras = {kind: check_camera(check(f"{title} camera"), bag, found, kind, good[kind])
               for kind, title in TITLES.items() if found.counts.get(f"{kind}_info")}
    usable = [head for head in found.depth if not depth_problem(found, head)]
    said = None
    if found.depth and found.depth[0].frame_id and color_frame(found, found.depth[0].order):
        def ask(pose):
            if usable and len(cameras) == len(TITLES) and all(cameras.values()):
                return _warnings_of_rig(bag, found, usable[0], good["rgb"], pose, optics, invalid_values)
            return None
        said = check_transform(check("transform"), bag, found, found.depth[0], ask)

    assembled = assemble(found, rules, usable)
    brackets = assembled.found
    report.brackets = [{"bracket_id": bracket.number, "frames": len(bracket.frames), "depth": bracket.depth is not None}
                       for bracket in brackets]
    if found.rgb:
        check_stamps(check("stamps"), bag, found, not any(bracket.depth for bracket in brackets))
        check_brackets(check("brackets"), bag, found, assembled, rules)
    if brackets and usable:
        check_depth_in_time(check("depth in time"), brackets, usable, rules)

    messages = [bag.read_at(head.place) for head in sample(usable, DEPTH_SAMPLES)]
    images = [depth_mm(message, invalid_values) for message in messages]
    if usable:
        check_depth_values(check("depth values"), bag.topics["depth"], messages, images, said.unit if said else "")
    if said:
        check_overlap(check("overlap"), said)
    known = np.concatenate([image[image > 0] for image in images]) if images else np.zeros(0)
    recorded = optics_at(found, found.depth[0].order if found.depth else 0)
    lens = check("optics")
    check_optics(lens, bag, found, recorded, optics, int(known.min()) if len(known) else None,
                 said.circle_of_confusion if said else "")

    accepted = {head.order for head in good["rgb"]}
    for bracket in brackets:
        bracket.frames = [frame for frame in bracket.frames if frame.head.order in accepted]
    brackets = [bracket for bracket in brackets if bracket.frames]
    if brackets:
        if lens.level != ERROR:
            check_focus_steps(check("focus steps"), brackets, optics or recorded, known)
        chosen = sample(list(enumerate(brackets)), BRACKETS)
        samples = [Sample(bag, number, bracket, FRAMES // len(chosen)) for number, bracket in chosen]
        check_exposure(check("exposure"), len(brackets), samples)
        check_focus_change(check("focus change"), brackets, samples)
    return report


def _warnings_of_rig(bag, found, head, pictures, pose, optics, invalid_values):
    """rig_warnings() of a depth image, or None. head: of that image; pictures: heads of colour images; pose: Pose."""
    depth = depth_mm(bag.read_at(head.place), invalid_values)
    try:
        rig = Rig(camera_at(found, "depth", head.order), camera_at(found, "rgb", head.order), pose.R, pose.t,
                  optics or optics_at(found, head.order), quaternion=pose.quaternion)
        picture = min(pictures, key=lambda other: abs(other.order - head.order), default=None)
        picture = None if picture is None else bgr(bag.read_at(picture.place))
    except (RigError, ImageError):
        return None
    return rig_warnings(rig, depth, picture) if depth.any() else None
