# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node focus_bracket_camera: shoots focus brackets on request or at a fixed rate."""
import math
import threading
import time

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_srvs.srv import Trigger, TriggerResponse

from all_in_focus.camera import frame_publisher
from all_in_focus.camera.bracket import PREVIEW, STILL
from all_in_focus.camera.frame_publisher import FramePublisher
from all_in_focus.camera.interface import CameraError
from all_in_focus.camera.makers import MAKERS, maker_of
from all_in_focus.camera.session import CURRENT, FAR, MOTOR, NEAR, NONE, Session
from all_in_focus.msg import FocusPlan
from all_in_focus.parameters import Parameter
from all_in_focus.srv import Shoot, ShootResponse

LONGEST_CHECK = 0.5  # s; a request waits for a check of the camera, but not for a bracket


PARAMETERS = {
    "port": Parameter("", "as gphoto2 --auto-detect names it; empty: the first camera"),
    "model": Parameter("", "as gphoto2 --auto-detect names it; empty: the first camera"),
    "drive": Parameter(MOTOR, "motor; none: a person turns the focus ring", (MOTOR, NONE)),
    "maker": Parameter("", "name of the maker's rules; empty: by the camera's own name"),
    "frames": Parameter(STILL, "still; preview: live view", (STILL, PREVIEW)),
    "count": Parameter(9, "frames in a bracket", 1),
    "step": Parameter(1, "focus steps from frame to frame, > 0 goes far"),
    "first": Parameter(0, "steps to the first frame"),
    "step_size": Parameter(0, "of one step, in the maker's unit; 0: typical of the maker", 0),
    "settle": Parameter(-1.0, "s, pause after a move; < 0: typical of the maker"),
    "home": Parameter("", "current, near or far: where step 0 is; empty: current, with a focus_table near", (CURRENT, NEAR, FAR)),
    "focus_table": Parameter([], "[{step: 0, mm: 450}, {step: 40, mm: 900}]: see calibrate_focus"),
    "rate": Parameter(0.0, "brackets a second while somebody listens; 0: by service ~bracket", 0),
    "plan": Parameter(False, "brackets at a rate are those of segmentation/focus_plan"),
    **frame_publisher.PARAMETERS,
    "white_balance": Parameter("", "a choice of the camera, where it would choose by itself"),
    "iso": Parameter("", "a choice of the camera, where it would choose by itself"),
    "keep_files": Parameter(True, "false: pictures are deleted from the card once fetched"),
    "patience": Parameter(5.0, "s, how long a busy camera is asked again", 0),
    "timeout": Parameter(10.0, "s, how long a picture may take to come", 0),
    "reconnect": Parameter(2.0, "s between attempts to find the camera", 0.05),
    "diagnostic_period": Parameter(1.0, "s between checks of the connection", 0.01),
}


def check(settings):
    """ValueError for values of PARAMETERS that are impossible, or contradict each other."""
    if settings.maker and maker_of(settings.maker) is None:
        raise ValueError(f"~maker: '{settings.maker}' is not one of {', '.join(maker.name for maker in MAKERS)}")
    if settings.drive == NONE and (settings.focus_table or settings.home not in ("", CURRENT)):
        raise ValueError(f"~drive: {NONE} takes neither ~focus_table nor ~home: focus is set by hand")
    if settings.drive == MOTOR and settings.step == 0 and settings.count > 1:
        raise ValueError(f"~step: 0 would take the same picture {settings.count} times")
    if settings.plan and not settings.focus_table:
        raise ValueError("~plan: needs a ~focus_table, which gives the focus distance of each step")


class FocusBracketCamera:
    """camera: a GphotoCamera, closed; settings: values of PARAMETERS."""

    def __init__(self, camera, settings):
        check(settings)
        self._settings = settings
        self._session = Session(camera, settings, rospy.Time.now)
        self._frames = FramePublisher(settings)
        self._frames.announce()
        self._lock = threading.Lock()  # guards the camera, which does one thing at a time
        self._plan = None
        self._bracket_id = 0
        self._healthy = False  # result of the last check
        self._last_warnings = []
        self._level, self._status = DiagnosticStatus.WARN, "looking for the camera"
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=1)
        if self._session.scale:
            rospy.Subscriber("segmentation/focus_plan", FocusPlan, self._on_plan, queue_size=1)
        rospy.Service("~bracket", Trigger, lambda _: self._answer_trigger(False))
        rospy.Service("~bracket_planned", Trigger, lambda _: self._answer_trigger(True))
        rospy.Service("~shoot", Shoot, self._answer_shoot)

    def run(self):
        """Until shutdown: shoot brackets at the rate, and check the connection between them."""
        next_bracket, next_check = time.monotonic(), 0.0
        try:
            while not rospy.is_shutdown():
                now = time.monotonic()
                if now >= next_check:
                    with self._lock:
                        self._check()
                        self._diagnose()
                    settings = self._settings
                    next_check = time.monotonic() + (settings.diagnostic_period if self._session.connected else
                                                     settings.reconnect)
                # At a rate only while somebody subscribes to the pictures: each of them wears the shutter.
                if self._settings.rate and self._session.connected and now >= next_bracket and self._frames.has_listeners():
                    next_bracket = max(next_bracket + 1 / self._settings.rate, now)
                    with self._lock:
                        self._shoot(self._settings.plan)
                time.sleep(0.02)
        finally:
            with self._lock:
                self._session.close()

    def _on_plan(self, plan):
        self._plan = plan

    def _report(self, text, level=DiagnosticStatus.WARN):
        """Log a line, once until it changes, and make it the status in the diagnostics."""
        if text != self._status:
            (rospy.logwarn if level else rospy.loginfo)("%s", text)
        self._level, self._status = level, text

    def _diagnose(self):
        status = DiagnosticStatus(self._level, rospy.get_name().lstrip("/") + ": camera", self._status,
                                  self._session.model, [KeyValue("brackets", str(self._bracket_id))])
        message = DiagnosticArray(status=[status])
        message.header.stamp = rospy.Time.now()
        self._diagnostics.publish(message)

    def _check(self):
        self._healthy &= self._session.connected
        try:
            self._session.check()
            if not self._healthy:
                self._frames.announce()  # again: another program may have had the camera, and published its own calibration
                self._report_ready()
            self._healthy = True
            self._warn(self._session.take_warnings())
        except CameraError as error:
            self._healthy = False
            again = "" if self._session.connected else f"; trying again every {self._settings.reconnect:g} s"
            self._report(str(error) + again, DiagnosticStatus.ERROR if again else DiagnosticStatus.WARN)

    def _report_ready(self):
        self._report("ready: " + self._session.description, DiagnosticStatus.OK)

    def _answer_trigger(self, planned):
        answer = self._answer(planned, (), ())
        return TriggerResponse(answer.success, answer.message)

    def _answer_shoot(self, request):
        if not self._frames.has_listeners():
            return ShootResponse(message=f"nobody listens to {rospy.resolve_name('rgb/image')}")
        return self._answer(request.planned, request.focus_distance, request.exposure_time)

    def _answer(self, planned, distances, exposures):
        if not self._lock.acquire(timeout=LONGEST_CHECK):
            return ShootResponse(message="the camera is shooting or being looked for: ask again in a moment")
        try:
            return self._shoot(planned, distances, exposures)
        finally:
            self._lock.release()

    def _shoot(self, planned, distances=(), exposures=()):
        """ShootResponse. distances: in m, empty: as planned, or as the node is set; exposures: times in s."""
        answer = ShootResponse(bracket_id=self._bracket_id)
        released = []

        def on_release(frame):
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("shutdown")
            frame.bracket_id = self._bracket_id
            self._frames.publish_focus(frame)
            released.append(frame)

        def publish(frame):
            self._frames.publish(frame)
            answer.frames += 1

        try:
            if not self._session.connected:
                answer.message = self._status
                return answer
            if planned and self._plan:
                distances = self._plan.focus_distance
            answer.message = self._why_not(planned, distances, exposures)
            if answer.message:
                self._report(answer.message)
                return answer
            self._session.shoot(publish, on_release, exposures, distances)
        except (CameraError, rospy.ROSException) as error:
            answer.message = f"bracket {self._bracket_id} broke off after {answer.frames} frames: {error}"
            self._report(answer.message)
            return answer
        finally:
            warnings = self._session.take_warnings()
            self._warn(warnings)
            if released:  # this id is taken, whether or not the picture came
                self._bracket_id += 1
        self._report_ready()
        answer.success, answer.message = True, "; ".join([f"{answer.frames} frames"] + warnings)
        return answer

    def _warn(self, warnings):
        """Log what was not logged for the bracket before."""
        for warning in warnings:
            if warning not in self._last_warnings:
                rospy.logwarn("%s", warning)
        self._last_warnings = warnings or self._last_warnings

    def _why_not(self, planned, distances, exposures):
        """Why the frames that are asked for cannot be taken; empty if they can."""
        if (planned or len(distances)) and not self._session.scale:
            return "no ~focus_table: the focus distances of the steps are unknown"
        if planned and not self._plan:
            return f"no plan has come on {rospy.resolve_name('segmentation/focus_plan')} yet"
        if planned and not len(distances):
            return "the plan is empty: no region has a depth"
        frames = len(distances) or self._settings.count
        if len(exposures) not in (0, 1, frames):
            return f"{len(exposures)} exposure times for {frames} frames: give one for all, or one for each"
        wrong = [time for time in exposures if not (time > 0 and math.isfinite(time))]
        return f"{wrong[0]:g} s is no exposure time" if wrong else ""


def shoot(settings, camera_at):
    """Until shutdown. camera_at(port, model) -> GphotoCamera."""
    FocusBracketCamera(camera_at(settings.port, settings.model), settings).run()
