# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All checks of a bag, in the order in which a person would repair what they find."""
from functools import partial

import numpy as np

from all_in_focus.bag.brackets import assemble
from all_in_focus.bag.check.sweeps import check_brackets, check_focus_steps, check_optics
from all_in_focus.bag.check.cameras import check_camera, check_overlap, check_transform, rig_warnings
from all_in_focus.bag.check.pixels import (BRACKETS, FRAMES, Sample, check_depth_values, check_exposure,
                                           check_focus_change, check_images, sample)
from all_in_focus.bag.check.findings import BagReport, Check
from all_in_focus.bag.check.recording import TITLES, check_depth_in_time, check_file, check_stamps, check_topics
from all_in_focus.image_messages import ImageError, bgr, depth_mm
from all_in_focus.bag.recorded_rig import camera_at, color_frame, depth_problem, optics_at
from all_in_focus.bag.scan import fetch, scan
from all_in_focus.files.rig import Rig, RigError

DEPTH_SAMPLES = 3


def check_bag(bag, rules, invalid_values=(0,), optics=None):
    """BagReport of a BagFile. rules: of brackets; invalid_values: mm that mean unknown; optics: instead of the bag's.

    Raises BagError where it cannot be read to its end.
    """
    return _Checker(bag, rules, invalid_values, optics).run()


class _Checker:
    def __init__(self, bag, rules, invalid_values, optics):
        self._bag, self._rules, self._invalid_values, self._given_optics = bag, rules, invalid_values, optics
        self._report = BagReport(bag.path)
        self._scan = scan(bag, pixels=True)

    def run(self):
        check_file(self._check("file"), self._bag)
        check_topics(self._check("topics"), self._bag, self._scan)
        good, cameras, said = {"depth": [], "rgb": []}, {"depth": None, "rgb": None}, None
        for kind, title in TITLES.items():
            if self._scan_has(kind):
                good[kind] = check_images(self._check(f"{title} image"), self._bag, self._scan, kind)
        for kind, title in TITLES.items():
            if self._scan_has(f"{kind}_info"):
                cameras[kind] = check_camera(self._check(f"{title} camera"), self._bag, self._scan, kind, good[kind])
        depth = self._scan.depth
        usable = [head for head in depth if not depth_problem(self._scan, head)]
        if depth and depth[0].frame_id and color_frame(self._scan, depth[0].order):
            ask = partial(self._ask, usable if all(cameras.values()) else [], good["rgb"])
            said = check_transform(self._check("transform"), self._bag, self._scan, depth[0], ask)
        else:
            self._skip("transform")
        assembled = assemble(self._scan, self._rules, usable)
        brackets = assembled.found
        self._report.brackets = [{"bracket_id": bracket.number, "frames": len(bracket.frames),
                                  "depth": bracket.depth is not None} for bracket in brackets]
        self._check_timing(brackets, assembled, usable)
        images = self._check_depth(usable, said)
        self._check_pictures(brackets, images, {head.order for head in good["rgb"]}, said)
        return self._report

    def _check(self, name):
        return Check(self._report, name)

    def _skip(self, *names):
        self._report.skipped += names

    def _scan_has(self, kind):
        return self._scan.counts.get(kind, 0) > 0

    def _check_timing(self, brackets, assembled, usable):
        if not self._scan.rgb:
            self._skip("stamps", "brackets", "depth in time")
            return
        alone = not any(bracket.depth for bracket in brackets)
        check_stamps(self._check("stamps"), self._bag, self._scan, alone)
        check_brackets(self._check("brackets"), self._bag, self._scan, assembled, self._rules)
        if brackets and usable:
            check_depth_in_time(self._check("depth in time"), brackets, usable, self._rules)
        else:
            self._skip("depth in time")

    def _ask(self, usable, pictures, pose):
        """rig_warnings() of the first usable depth image, or None. usable, pictures: heads of images; pose: Pose."""
        if not usable:
            return None
        head = usable[0]
        depth = depth_mm(fetch(self._bag, "depth", head), self._invalid_values)
        try:
            rig = Rig(camera_at(self._scan, "depth", head.order), camera_at(self._scan, "rgb", head.order), pose.R, pose.t,
                      self._given_optics or optics_at(self._scan, head.order), quaternion=pose.quaternion)
            picture = min(pictures, key=lambda other: abs(other.order - head.order), default=None)
            picture = None if picture is None else bgr(fetch(self._bag, "rgb", picture))
        except (RigError, ImageError):
            return None
        return rig_warnings(rig, depth, picture) if depth.any() else None

    def _check_depth(self, usable, said):
        """Returns the sampled depth images, mm."""
        if not usable:
            self._skip("depth values", "overlap")
            return []
        messages = [fetch(self._bag, "depth", head) for head in sample(usable, DEPTH_SAMPLES)]
        images = [depth_mm(message, self._invalid_values) for message in messages]
        check_depth_values(self._check("depth values"), self._bag.topics["depth"], messages, images)
        if said:
            check_overlap(self._check("overlap"), said)
        else:
            self._skip("overlap")
        return images

    def _check_pictures(self, brackets, images, fit, said):
        """fit: `order` of the frames that the nodes accept; said: of rig_warnings(), or None."""
        known = np.concatenate([image[image > 0] for image in images]) if images else np.zeros(0)
        optics = optics_at(self._scan, self._scan.depth[0].order if self._scan.depth else 0)
        check_optics(self._check("optics"), self._bag, self._scan, optics, self._given_optics,
                     int(known.min()) if len(known) else None, said.circle_of_confusion if said else "")
        for bracket in brackets:
            bracket.frames = [frame for frame in bracket.frames if frame.head.order in fit]
        brackets = [bracket for bracket in brackets if bracket.frames]
        if not brackets:
            self._skip("focus steps", "exposure", "focus change")
            return
        if self._report.failed("optics"):
            self._skip("focus steps")
        else:
            check_focus_steps(self._check("focus steps"), brackets, self._given_optics or optics, known)
        chosen = sample(list(enumerate(brackets)), BRACKETS)
        samples = [Sample(self._bag, number, bracket, FRAMES // len(chosen)) for number, bracket in chosen]
        check_exposure(self._check("exposure"), len(brackets), samples)
        check_focus_change(self._check("focus change"), brackets, samples)
