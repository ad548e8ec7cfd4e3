# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of rviz and image_view with the results of a bag: a master, the nodes and screens of their own."""
import contextlib
import os
import posixpath
import tempfile
import time
import xmlrpc.client
from pathlib import Path
from xml.sax.saxutils import quoteattr

import rosgraph
import rospkg
import rospy
import yaml
from roslib.packages import find_node

from all_in_focus.files import yaml_file
from all_in_focus.replay.launch import Launch
from all_in_focus.replay.player import BagPlayer, Limits, PlayError
from all_in_focus.rviz.virtual_screen import ScreenError, VirtualScreen, changed_share, check_programs

TOPIC_KEYS = ("Image Topic", "Color Image Topic", "Depth Map Topic", "Marker Topic", "Topic")


def _read(path):
    """Raises ValueError (one line)."""
    config = yaml_file.read(path, ValueError)
    try:
        config["Visualization Manager"]["Displays"], config["Visualization Manager"]["Global Options"]
    except (KeyError, TypeError) as error:
        raise ValueError(f"{path}: not an rviz configuration ({error})") from error
    return config


def displays(path):
    """Descriptions of the enabled displays of an .rviz file. Raises ValueError (one line)."""
    return [display for display in _read(path)["Visualization Manager"]["Displays"] if display.get("Enabled", True)]


def write_with_frame(path, frame, output):
    """Copies an .rviz file with another fixed frame: DepthCloud ignores rviz -f and uses that of the file."""
    config = _read(path)
    config["Visualization Manager"]["Global Options"]["Fixed Frame"] = frame
    Path(output).write_text(yaml.safe_dump(config), encoding="utf-8")


def topics_of(display):
    """Topics that a display subscribes to; for a depth image also the camera_info beside it."""
    names = [display[key] for key in TOPIC_KEYS if isinstance(display.get(key), str) and display[key]]
    if display.get("Depth Map Topic"):
        names.append(posixpath.join(posixpath.dirname(display["Depth Map Topic"]), "camera_info"))
    return names


def config_topics(path):
    """Topics that the displays of an .rviz file subscribe to, in order. Raises like displays()."""
    return list(dict.fromkeys(name for display in displays(path) for name in topics_of(display)))


LABELS = "segmentation/labels"
REPORT = "all_in_focus/report"
CHANGED = {"rviz": 0.15, "labels": 0.01}  # share of the screen that results change, at least


class RvizDied(ScreenError):
    """rviz crashed. Under load it does so now and then: DepthCloud uses Qt from a thread of its own."""


def default_config():
    return Path(rospkg.RosPack().get_path("all_in_focus")) / "rviz" / "all_in_focus.rviz"


def has_image_view():
    """Whether image_view can be found; Debian has the program and its package.xml in two packages."""
    try:
        return bool(find_node("image_view", "image_view"))
    except rospkg.ResourceNotFound:
        return False


def launch_text(mode, config, screens):
    """Launch XML of the nodes, rviz and, where it has a screen, image_view."""
    image_view = f"""<node pkg="image_view" type="image_view" name="labels_view">
    <remap from="image" to="{LABELS}"/>
    <param name="autosize" value="true"/>
    <env name="DISPLAY" value={quoteattr(screens['labels'].display)}/>
  </node>""" if "labels" in screens else ""
    return f"""<launch>
  <param name="/use_sim_time" value="true"/>
  <include file="$(find all_in_focus)/launch/all_in_focus.launch"><arg name="mode" value={quoteattr(mode)}/></include>
  <node pkg="rviz" type="rviz" name="rviz" args={quoteattr(f'-d {config}')} required="true">
    <env name="DISPLAY" value={quoteattr(screens['rviz'].display)}/>
  </node>
  {image_view}
</launch>
"""


class Graph:
    """The nodes and rviz; this process is a node of the same graph."""

    def __init__(self, launch, folder, timeout):
        self._timeout = timeout
        self._launch = Launch(Path(folder) / "log", texts=[launch])
        os.environ.update(ROS_MASTER_URI=self._launch.master_uri, ROS_HOSTNAME="localhost")
        self.close = self._launch.close

    def wait(self, condition, what):
        """Waits until the condition holds; ScreenError that says what was waited for."""
        end = time.monotonic() + self._timeout
        while not condition():
            self.check()
            if time.monotonic() > end:
                raise ScreenError(f"{what}: not within {self._timeout:g} s")
            time.sleep(0.1)

    def check(self):
        """Raises RvizDied, or ScreenError where the launch has ended for another reason."""
        if self._launch.ended():
            rviz_died = any(death.node == "rviz" for death in self._launch.deaths)
            raise (RvizDied if rviz_died else ScreenError)(f"the nodes have ended: {self._launch.reason()}")


def hears(node, topics):
    """Whether the node is connected to a publisher of each topic."""
    try:
        uri = rosgraph.Master("/rviz_pictures").lookupNode(node)
        with xmlrpc.client.ServerProxy(uri) as proxy:
            _, _, connections = proxy.getBusInfo("/rviz_pictures")
    except (rosgraph.MasterException, OSError, xmlrpc.client.Error):
        return False
    return set(topics) <= {connection[4] for connection in connections if connection[2] == "i" and connection[5]}


def take_pictures(contents, config, mode="refined", optics=None, timeout=60.0):
    """Plays a bag to the nodes and to rviz. Returns BGR pictures: "rviz", and "labels" if image_view is installed.

    contents: BagContents; config: an .rviz file; optics: of the lens, None: what the bag says; timeout: s for each
    step. Raises ScreenError, PlayError.
    """
    wanted = [f"/{topic.lstrip('/')}" for topic in config_topics(config)]
    check_programs("Xvfb", "import", "rviz")
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="rviz_screenshots."))
        screens = {"rviz": VirtualScreen()}
        stack.callback(lambda: [screen.close() for screen in screens.values()])
        if has_image_view():
            screens["labels"] = VirtualScreen(1600, 640)
        own_config = Path(folder) / "own.rviz"
        write_with_frame(config, contents.rgb_info.header.frame_id.lstrip("/"), own_config)
        graph = Graph(launch_text(mode, own_config, screens), folder, timeout)
        stack.callback(graph.close)

        graph.wait(rosgraph.is_master_online, "the master to answer")
        rospy.init_node("rviz_screenshots", disable_signals=True)
        stack.callback(rospy.signal_shutdown, "done")
        seen = {}
        outputs = {topic: rospy.Subscriber(topic, rospy.AnyMsg, lambda _, topic=topic: seen.update({topic: True}))
                   for topic in [*wanted, f"/{LABELS}", f"/{REPORT}"]}
        graph.wait(lambda: hears("/rviz", wanted), f"rviz to listen to {', '.join(wanted)}")
        if "labels" in screens:
            graph.wait(lambda: hears("/labels_view", [f"/{LABELS}"]), f"image_view to listen to /{LABELS}")

        player = BagPlayer(contents, Limits(connect=timeout), heartbeat=lambda done: graph.check())
        try:
            before = _play(player, contents, optics, outputs, seen, screens)
        except PlayError:
            graph.check()  # raises the reason for it
            raise
        graph.wait(lambda: len(seen) == len(outputs), "every display to get its message")
        return {name: _settled(screen, before[name], CHANGED[name], graph, timeout) for name, screen in screens.items()}


def _play(player, contents, optics, outputs, seen, screens):
    """Returns pictures of the screens from before the bag was played."""
    player.connect({topic[1:]: subscriber for topic, subscriber in outputs.items()})
    if optics or contents.optics:
        player.set_optics(optics or contents.optics)
    before = {name: screen.picture() for name, screen in screens.items()}
    player.play(follow_optics=optics is None)
    player.end_bracket(lambda number: f"/{REPORT}" in seen)
    if f"/{REPORT}" not in seen:
        raise PlayError("no result came: does the bag have a whole bracket?")
    return before


def _settled(screen, before, share, graph, timeout):
    def accept(now):
        graph.check()
        return changed_share(before, now) > share
    return screen.settled_picture(accept, timeout)
