# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cases for the three nodes: each takes (case, scene, seconds)."""
import copy
import os
import pickle
import queue
import shutil
import signal
import subprocess
import threading
import time
from contextlib import contextmanager

import dynamic_reconfigure.client
import numpy as np
import rosbag
import rospy
from cv_bridge import CvBridge
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from all_in_focus.files.rig import load_rig
from all_in_focus.files.rig_messages import camera_info
from all_in_focus.msg import FocusFrame, FusionReport
from file_helpers import run_script, wait_until
from graph import FRAMES, NODES, Graph
from mutation import mutate_message
from tool_helpers import succeeded
from unload_testing import Manager

BATCH = 100  # mutated messages between two good brackets
RATE = 400  # mutated messages a second at most
LOSS = 0.15  # share of the messages that the relay loses
LATENCY = 0.15  # s that it takes for one at most
PROMISED = 10  # s from kill -9 until results are right again, as docs/reliability.md says
MEMORY_GROWTH = 1.1  # of the manager, from the second quarter of the soak to the last
END = "/stress/end"  # topic of the message that ends a bag


def recovery():
    """s that a case allows: what is promised, on a computer with much else to do up to three times that, as its load says."""
    return PROMISED * min(3.0, max(1.0, os.getloadavg()[0] / os.cpu_count()))


@contextmanager
def working_graph(case, scene):
    """The nodes, once they have given a right bracket."""
    graph = Graph(scene, case.folder / case.name)
    try:
        if not graph.connected():
            raise RuntimeError("the nodes did not start")
        _, wrong = graph.good_within(60)
        if wrong:
            raise RuntimeError(f"the first bracket, before any stress: {wrong}")
        yield graph
    finally:
        graph.close()


# --- messages ---------------------------------------------------------------------------------------------------------

def plausible_messages(scene):
    """topic -> a message as the nodes expect it, for every input of the three nodes."""
    rig, bridge = load_rig(str(scene.rig)), CvBridge()
    depth, rgb = (Header(stamp=rospy.Time.now(), frame_id=frame) for frame in (rig.child_frame, rig.parent_frame))
    registered = np.full(scene.frames[0].shape[:2], 1000, np.uint16)
    labels = np.ones(scene.frames[0].shape[:2], np.int32)
    return {"/depth/image_raw": bridge.cv2_to_imgmsg(scene.depth_image, "16UC1", depth),
            "/depth/camera_info": camera_info(rig.depth, depth),
            "/rgb/camera_info": camera_info(rig.color, rgb),
            "/rgb/image": bridge.cv2_to_imgmsg(scene.frames[0], "bgr8", rgb),
            "/rgb/focus": FocusFrame(rgb, 1, 0, 5, False, 1.0),
            "/depth_registered/image": bridge.cv2_to_imgmsg(registered, "16UC1", rgb),
            "/depth_registered/image_raw": bridge.cv2_to_imgmsg(registered, "16UC1", rgb),
            "/depth_registered/camera_info": camera_info(rig.color, rgb),
            "/segmentation/labels": bridge.cv2_to_imgmsg(labels, "32SC1", rgb)}


def fuzz_messages(case, scene, seconds):
    """Mutated messages to every input of the three nodes; after each batch a good bracket must be right."""
    templates = plausible_messages(scene)
    with working_graph(case, scene) as graph:
        publishers = {topic: rospy.Publisher(topic, type(message), queue_size=50) for topic, message in templates.items()}
        pids, sent, batches, end, unsendable = graph.pids(), 0, 0, time.monotonic() + seconds, 0
        while time.monotonic() < end and not case.failures:
            batch = []
            for _ in range(BATCH):
                topic = case.rng.choice(sorted(templates))
                message = copy.deepcopy(templates[topic])
                message.header.stamp = rospy.Time.now()
                mutate_message(message, case.rng)
                batch.append((topic, message))
                try:
                    publishers[topic].publish(message)
                    sent += 1
                except (rospy.ROSException, rospy.ROSSerializationException, ValueError, TypeError):
                    unsendable += 1  # a mutation that cannot be a message
                time.sleep(1 / RATE)
            batches += 1
            _, wrong = graph.good_within(30)
            if wrong or graph.pids() != pids:
                path = case.keep(f"batch_{batches}.pickle", pickle.dumps(batch))
                case.fail(f"after batch {batches}: {wrong or 'a process was replaced'}; kept in {path}")
        for line in graph.deaths():
            case.fail(line)
        for publisher in publishers.values():
            publisher.unregister()
    case.summary = f"{sent} messages in {batches} batches, {unsendable} could not be sent"


# --- network ----------------------------------------------------------------------------------------------------------

class LossyRelay:
    """Publishes what it is given, each topic in its order, some time later, and some of it never."""

    def __init__(self, rng):
        self._rng, self._queues, self._threads, self.lost, self.sent = rng, {}, [], 0, 0

    def publish(self, publisher, message):
        """Returns whether the message gets through."""
        if publisher not in self._queues:
            self._queues[publisher] = queue.Queue()
            self._threads.append(threading.Thread(target=self._forward, args=(publisher, self._queues[publisher])))
            self._threads[-1].start()
        kept = self._rng.random() >= LOSS
        if kept:
            self._queues[publisher].put((message, self._rng.uniform(0, LATENCY)))
        self.sent += 1
        self.lost += not kept
        return kept

    @staticmethod
    def _forward(publisher, messages):
        for message, latency in iter(messages.get, None):
            time.sleep(latency)
            publisher.publish(message)

    def close(self):
        """When all has been sent."""
        for messages in self._queues.values():
            messages.put(None)
        for thread in self._threads:
            thread.join()


def lose_messages(case, scene, seconds):
    """A relay that loses and delays messages: every bracket is reported, right if whole, else with what it lacks."""
    announced, reports, pictures = {}, {}, {}  # bracket -> its frames of which image and focus get through, ...
    with working_graph(case, scene) as graph:
        relay = LossyRelay(case.rng)
        subscribers = [rospy.Subscriber("/all_in_focus/report", FusionReport, lambda one: reports.update({one.bracket_id: one})),
                       rospy.Subscriber("/all_in_focus/image", Image, lambda one: pictures.update({one.header.stamp: one}),
                                        buff_size=2 ** 22)]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            bracket, through = graph.send_bracket(relay.publish)
            announced[bracket] = through
            time.sleep(0.3)
        relay.close()
        time.sleep(1)
        took, wrong = graph.good_within(recovery())
        if took is None:
            case.fail(f"no right bracket after the loss has ended: {wrong}")
        wait_until(lambda: all(bracket in reports for bracket, through in announced.items() if through), 10)
        for subscriber in subscribers:
            subscriber.unregister()
        for line in graph.deaths():
            case.fail(line)
    whole = 0
    for bracket, through in announced.items():
        report = reports.get(bracket)
        if report is None:
            if through:
                case.fail(f"bracket {bracket}, of which {through} frames got through, was not reported")
        elif report.has_labels and report.frames_seen == FRAMES:
            whole += 1
            picture = pictures.get(report.header.stamp)
            if picture is not None and not np.array_equal(CvBridge().imgmsg_to_cv2(picture, "bgr8"), scene.expected):
                case.fail(f"bracket {bracket} is whole, with other pixels than those of fuse_stack: {report.notes}")
        elif not report.notes and not report.frames_missing:
            case.fail(f"the report of bracket {bracket} does not tell what it lacks")
    if not whole:
        case.fail("no bracket was whole")
    case.summary = f"{relay.lost} of {relay.sent} messages lost; {len(announced)} brackets, {len(reports)} reports, {whole} whole"


# --- processes --------------------------------------------------------------------------------------------------------

def kill_processes(case, scene, seconds):
    """kill -9 of each process of all_in_focus.launch, at any age; results must be right again within 10 s."""
    times, end, rounds = [], time.monotonic() + seconds, 0
    with working_graph(case, scene) as graph:
        while (time.monotonic() < end or rounds == 0) and not case.failures:
            rounds += 1
            for node in NODES:
                time.sleep(case.rng.uniform(0, 3))
                pid = wait_until(lambda: graph.pids().get(node), recovery())
                if pid is None:
                    case.fail(f"{node} does not run")
                    continue
                os.kill(pid, signal.SIGKILL)
                limit, begin = recovery(), time.monotonic()
                if not wait_until(lambda: graph.pids().get(node) not in (None, pid), limit):
                    case.fail(f"{node} was killed: not started again within {limit:.0f} s")
                    continue
                _, wrong = graph.good_within(max(1.0, limit - (time.monotonic() - begin)))
                times.append((time.monotonic() - begin, node))
                if wrong:
                    case.fail(f"{node} was killed: not right again within {limit:.0f} s: {wrong}")
    longest, node = max(times, default=(0, "none"))
    case.summary = f"{rounds} rounds of {len(NODES)}, right again after {longest:.1f} s at most ({node})"


def unload_nodelets(case, scene, seconds):
    """Nodelets are unloaded at work, and loaded again by load_nodelet: the manager lives, results are right again within 10 s."""
    times, end = [], time.monotonic() + seconds
    with working_graph(case, scene) as graph:
        manager = Manager("/all_in_focus_manager")
        while time.monotonic() < end and not case.failures:
            graph.send_bracket(lambda publisher, message: publisher.publish(message))
            try:
                for nodelet in case.rng.sample(("depth_preprocess", "segmenter", "fusion"), 3):
                    time.sleep(case.rng.uniform(0, 0.1))
                    manager.unload(nodelet)
            except (AssertionError, rospy.ServiceException) as error:
                case.fail(f"round {len(times) + 1}: {error}")
                break
            took, wrong = graph.good_within(recovery())
            times.append(took or 0)
            if wrong:
                case.fail(f"round {len(times)}: not right again within {recovery():.0f} s: {wrong}")
        for line in graph.deaths():
            case.fail(line)
    case.summary = f"{len(times)} rounds, right again after {max(times, default=0):.1f} s at most"


# --- bags -------------------------------------------------------------------------------------------------------------

def loop_bag(case, scene, seconds):
    """rosbag play --loop --clock: a round that ends after its last frame gives a right bracket, every time.

    Half of the time the bag ends with its last frame: time jumps while that is on its way. About half of these frames are
    lost; the report of a bracket that is not whole must say what it lacks.
    """
    tight, quiet = case.folder / "loop_tight.bag", case.folder / "loop_quiet.bag"
    succeeded(run_script("make_bag", *scene.files, "--rate", 5, "--output", tight))
    shutil.copyfile(str(tight), str(quiet))
    with rosbag.Bag(str(quiet), "a") as bag:
        end = rospy.Time.from_sec(bag.get_end_time() + 1.5)
        bag.write(END, Header(stamp=end), end)
    rospy.set_param("/use_sim_time", True)
    summaries = []
    try:
        for path in (quiet, tight):
            pictures, reports, rounds, deaths = play_in_loop(case, scene, path, seconds / 2)
            whole = [report for report in reports if report.has_labels and report.frames_seen == FRAMES]
            right = sum(np.array_equal(CvBridge().imgmsg_to_cv2(picture, "bgr8"), scene.expected) for picture in pictures)
            if not whole:
                case.fail(f"{path.name}: no bracket was whole: {reports[-1].notes if reports else 'none was reported'}")
            if right < len(whole):
                case.fail(f"{path.name}: {len(whole)} brackets were whole, {right} results have the pixels of fuse_stack")
            if path == quiet and right < rounds:
                case.fail(f"{path.name}: {rounds} rounds, {right} right brackets: "
                          f"{[report.notes for report in reports if report not in whole][:3]}")
            for report in reports:
                if report not in whole and not report.notes and not report.frames_missing:
                    case.fail(f"{path.name}: the report of a bracket of {report.frames_seen} frames does not tell what it lacks")
            for line in deaths:
                case.fail(line)
            summaries.append(f"{path.stem}: {len(reports)} brackets, {len(whole)} whole, {right} right")
    finally:
        rospy.delete_param("/use_sim_time")
    case.summary = "; ".join(summaries)


def play_in_loop(case, scene, bag, seconds):
    """(results, reports, rounds that ended, deaths of processes); the first round, during which nodes connect, is left out."""
    graph = Graph(scene, case.folder / case.name)
    pictures, reports, ends = [], [], []
    subscribers = [rospy.Subscriber("/all_in_focus/image", Image, pictures.append, buff_size=2 ** 22),
                   rospy.Subscriber("/all_in_focus/report", FusionReport, reports.append),
                   rospy.Subscriber(END, Header, ends.append)]
    player = None
    try:
        graph.connected()
        player = subprocess.Popen(["rosbag", "play", "--quiet", "--clock", "--loop", "--delay", "3", str(bag)],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, stdin=subprocess.DEVNULL)
        wait_until(lambda: ends or (reports and "quiet" not in bag.name), 60)
        time.sleep(0.2)
        before = len(pictures), len(reports), len(ends)
        time.sleep(seconds)
        wait_until(lambda: not ends or len(ends) > before[2], 30)
        rounds = len(ends) - before[2]
        time.sleep(0.2)
        return pictures[before[0]:], reports[before[1]:], rounds, graph.deaths()
    finally:
        if player:
            player.send_signal(signal.SIGINT)
            player.wait(20)
        for subscriber in subscribers:
            subscriber.unregister()
        graph.close()


# --- soak -------------------------------------------------------------------------------------------------------------

def soak(case, scene, seconds):
    """Good brackets and any change of parameters for a long time: all right, and memory stays flat."""
    brackets, changes, memory, begin = 0, 0, [], time.monotonic()
    with working_graph(case, scene) as graph:
        clients = [dynamic_reconfigure.client.Client(node, timeout=20) for node in ("/depth_preprocess", "/segmenter", "/fusion")]
        usual = {client: client.get_configuration(timeout=10) for client in clients}
        described = {client: client.get_parameter_descriptions(timeout=10) for client in clients}
        while time.monotonic() < begin + seconds and len(case.failures) < 3:
            client = case.rng.choice(clients)
            parameter = case.rng.choice(described[client])
            client.update_configuration({parameter["name"]: any_value(parameter, case.rng)})
            client.update_configuration({parameter["name"]: usual[client][parameter["name"]]})
            changes += 1
            wrong = graph.good_bracket(15)
            brackets += 1
            if wrong:
                case.fail(f"bracket {brackets}, after {parameter['name']} was changed and restored: {wrong}")
            memory.append(graph.resident_mb())
        for client in clients:
            client.close()
    quarter = len(memory) // 4
    early, late = max(memory[quarter:2 * quarter], default=0), max(memory[-quarter:], default=0)
    if quarter and late > MEMORY_GROWTH * early:
        case.fail(f"the manager's memory grew from {early:.0f} to {late:.0f} MB")
    case.summary = f"{brackets} brackets, {changes} changes, {early:.0f} MB in the second quarter, {late:.0f} MB in the last"


def any_value(parameter, rng):
    """Of a parameter of dynamic_reconfigure, within the range that the server clamps to."""
    if parameter["type"] == "bool":
        return rng.random() < 0.5
    if parameter["type"] == "str":
        return rng.choice(("", "paper", "refined", "full", "nonsense"))
    low, high = (min(max(parameter[end], -1e6), 1e6) for end in ("min", "max"))
    value = rng.choice((low, high, rng.uniform(low, high)))
    return int(value) if parameter["type"] == "int" else value
