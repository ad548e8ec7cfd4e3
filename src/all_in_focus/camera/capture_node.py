# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node capture: one bracket and its result, as the action all_in_focus/capture."""
import threading
import time

import actionlib
import rospy
from actionlib_msgs.msg import GoalStatus
from dynamic_reconfigure.msg import Config, StrParameter
from dynamic_reconfigure.srv import Reconfigure
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from all_in_focus.msg import CaptureAction, CaptureFeedback, CaptureResult, Progress
from all_in_focus.srv import Shoot, ShootResponse

CAMERA, SET_MODE, PROGRESS = "focus_bracket_camera/shoot", "fusion/set_parameters", "all_in_focus/progress"
LARGEST = 2 ** 26  # bytes that are read at once
PATIENCE = 10.0  # s for other nodes to be there, and for the camera to be ready
DEPTH_PATIENCE = 5.0  # s; without depth the bracket is fused by sharpness
POLL, RETRY, STATUS_PERIOD = 0.02, 0.2, 0.2  # s


class _Work:
    """Work on one goal, in a thread of its own: the brackets that begin from now on, and their results."""

    def __init__(self, handle):
        self._handle, self._goal = handle, handle.get_goal()
        self._frames, self._results = [], []
        self._has_depth, self._depth_by = threading.Event(), 0.0
        self._early = set()  # numbers of brackets that began before any depth had come
        self._answer = None  # of the camera, when it has shot the bracket

    def run(self, timeout):
        """CaptureResult, or None when cancelled. timeout: s, how long nothing may happen. RuntimeError, or what rospy raises."""
        # The mode is set before anybody listens: the fusion starts with it, and a folder is played from then on.
        before = _set_mode(self._goal.mode) if self._goal.mode else ""
        subscribers = []
        try:
            has_camera = self._has_camera()
            subscribers.append(rospy.Subscriber(PROGRESS, Progress, self._on_progress, buff_size=LARGEST))
            if self._goal.with_points:
                subscribers.append(rospy.Subscriber("all_in_focus/points", rospy.AnyMsg))  # so the fusion makes them
            if not self._wait(lambda: all(one.get_num_connections() for one in subscribers), PATIENCE):
                raise RuntimeError(f"nobody publishes {rospy.resolve_name(PROGRESS)}: does the fusion run?")
            # A bracket takes depth from before its first frame.
            subscribers.append(rospy.Subscriber("depth_registered/processed", Header, lambda _: self._has_depth.set()))
            self.await_depth_from_now()
            if not self._wait(lambda: self._has_depth.is_set() or self._frames, DEPTH_PATIENCE):
                rospy.logwarn("no depth has come for %g s: it is not waited for any longer", DEPTH_PATIENCE)
            if has_camera:
                threading.Thread(target=self._ask_camera, daemon=True).start()
            return self._result(has_camera, timeout)
        finally:
            self._answer = self._answer or ShootResponse()  # nobody asks any more
            for subscriber in subscribers:
                subscriber.unregister()
            if before and not rospy.is_shutdown():
                _set_mode(before)

    def await_depth_from_now(self):
        self._depth_by = time.monotonic() + DEPTH_PATIENCE

    def _has_camera(self):
        """False where brackets come by themselves."""
        try:
            rospy.wait_for_service(CAMERA, RETRY)
        except rospy.ROSException:
            if self._goal.planned or self._goal.focus_distance or self._goal.exposure_time:
                raise RuntimeError("planned, focus_distance and exposure_time need a camera, and nobody offers "
                                   f"{rospy.resolve_name(CAMERA)}")
            return False
        return True

    def _on_progress(self, progress):
        """Of a bracket that had begun before, the rest counts for nothing."""
        if not progress.is_result:
            if progress.frame.index == 0 and not self._has_depth.is_set():
                self._early.add(progress.frame.bracket_id)
            if progress.frame.index == 0 or self._frames:
                self._frames.append(progress.frame)
        elif any(frame.bracket_id == progress.report.bracket_id for frame in self._frames):
            self._results.append(progress)

    def _wait(self, condition, patience):
        """Whether it holds in time; cancelled counts as that."""
        end = time.monotonic() + patience
        while not condition() and not self._is_over():
            if time.monotonic() > end:
                return False
            time.sleep(POLL)
        return True

    def _ask_camera(self):
        """Again while the camera is being looked for, has no plan yet, or shoots another bracket."""
        end = time.monotonic() + PATIENCE
        while self._answer is None:
            try:
                answer = rospy.ServiceProxy(CAMERA, Shoot)(self._goal.planned, self._goal.focus_distance,
                                                           self._goal.exposure_time)
            except rospy.ServiceException as error:
                answer = ShootResponse(message=str(error))
            if answer.success or answer.frames or time.monotonic() > end:
                self._answer = answer
            else:
                time.sleep(RETRY)

    def _is_over(self):
        return rospy.is_shutdown() or self._handle.get_goal_status().status == GoalStatus.PREEMPTING

    def _result(self, has_camera, timeout):
        told, changed = None, time.monotonic()
        while not self._is_over():
            answer = self._answer  # first: from then on, what is followed is the bracket that it names
            followed, feedback = self._followed(has_camera), CaptureFeedback("waiting", 0, 0)
            frames = [frame for frame in list(self._frames) if frame.bracket_id == followed]
            if frames:
                newest = frames[-1]
                feedback = CaptureFeedback("fusing" if newest.last else "shooting", newest.index + 1, newest.count)
            if feedback != told:
                told, changed = feedback, time.monotonic()
                self._handle.publish_feedback(feedback)
            if answer and not answer.success:
                raise RuntimeError(answer.message)
            for result in list(self._results):
                if result.report.bracket_id == followed and (answer or not has_camera):
                    if result.report.frames_used == 0:
                        raise RuntimeError("; ".join(result.report.notes))
                    points = result.points if self._goal.with_points else PointCloud2()  # others may listen to them
                    return CaptureResult(result.report, result.image, result.depth, points)
            if time.monotonic() > changed + timeout:
                raise RuntimeError(f"{'no result' if told.frame else 'no bracket has begun'} for {timeout:g} s")
            time.sleep(POLL)
        return None

    def _followed(self, has_camera):
        """Id of the goal's bracket, None before it has begun. One that came by itself before any depth did is fused by
        sharpness: where brackets follow each other, as from a folder that is played, the next one is better."""
        frames = list(self._frames)
        if self._answer:
            return self._answer.bracket_id
        if has_camera:  # it may shoot brackets of others before
            return frames[-1].bracket_id if frames else None
        early = self._early if time.monotonic() < self._depth_by else ()
        return next((frame.bracket_id for frame in frames if frame.bracket_id not in early), None)


def _set_mode(mode):
    """Returns the mode of before."""
    rospy.wait_for_service(SET_MODE, PATIENCE)
    reconfigure = rospy.ServiceProxy(SET_MODE, Reconfigure)

    def mode_after(*changes):
        return {entry.name: entry.value for entry in reconfigure(Config(strs=changes)).config.strs}["mode"]
    before = mode_after()
    if mode_after(StrParameter("mode", mode)) != mode:
        raise RuntimeError(f"mode '{mode}': the fusion knows paper, refined and restored")
    return before


def serve(settings):
    """Until shutdown."""
    busy = threading.Lock()

    def on_goal(handle):
        if not busy.acquire(blocking=False):
            handle.set_rejected(text="another goal is being worked on: cancel it, or wait")
            return
        handle.set_accepted()
        threading.Thread(target=execute, args=(handle,), daemon=True).start()

    def execute(handle):
        result, problem = None, ""
        try:
            result = _Work(handle).run(settings.timeout)
        except Exception as error:  # whatever it is, the goal has an end
            problem = str(error)
            rospy.logwarn("a goal is given up: %s", problem)
        busy.release()  # before the client is told: it may send the next goal at once
        if handle.get_goal_status().status == GoalStatus.PREEMPTING:
            handle.set_canceled(text="cancelled")
        elif result:
            handle.set_succeeded(result)
        else:
            handle.set_aborted(text=problem)

    # Time goes back where a bag begins anew. SimpleActionServer refuses goals that seem older then, and actionlib's
    # timer ends.
    rospy.set_param("~actionlib_status_frequency", 0)
    actions = actionlib.ActionServer("all_in_focus/capture", CaptureAction, on_goal, auto_start=False)
    actions.start()
    while not rospy.is_shutdown():
        actions.publish_status()
        time.sleep(STATUS_PERIOD)
