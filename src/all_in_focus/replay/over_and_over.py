# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Node replay_bag: plays a bag to the nodes over and over, to look at in rviz."""
from itertools import count
from pathlib import Path

import rospy

from all_in_focus.bag.bag_file import BagContents, load_topics
from all_in_focus.parameters import flag, number, text
from all_in_focus.replay.player import BagPlayer, PlayError

PATIENCE = 15.0  # s without somebody who looks, before that is said
PAUSE = 2.0  # s between two rounds, to look at the result
ACKNOWLEDGE = 300.0  # s; a frame is acknowledged when its picture is restored


def play():
    """Until shutdown; ValueError for a bag that cannot be played."""
    here = text("working_directory")
    path, rate, own_lens = Path(here, text("bag")), number("rate", 1.0, 0.001), flag("take_optics", False)
    names = text("topics")
    contents = BagContents(str(path), load_topics(Path(here, names)) if names else None,
                           transforms=not flag("rig_given", False))
    player, said = BagPlayer(contents, acknowledge=ACKNOWLEDGE), set()
    try:
        if own_lens and contents.optics:
            try:
                player.set_optics(contents.optics)
            except PlayError as error:  # the bag is played without it, too
                rospy.logwarn("the bag's lens: %s", error)
        while not rospy.is_shutdown():
            _play_once(player, rate, own_lens, said)
    except PlayError:
        if not rospy.is_shutdown():
            raise


def _connect(player):
    """Returns when every node listens, however long it takes: they do when somebody listens to them."""
    for attempt in count():
        try:
            return player.connect({}, PATIENCE)
        except PlayError as error:
            if rospy.is_shutdown():
                raise
            if attempt == 0:
                rospy.loginfo("waiting for somebody who looks: rviz, or rostopic hz all_in_focus/image (%s)", error)


def _play_once(player, rate, own_lens, said):
    """One round; ends when the last result is out, restored where that is asked for. What went wrong in it is
    logged, unless it is among the lines that were said."""
    _connect(player)

    def expect_nodes(_):
        """One that has left would acknowledge nothing: the round ends."""
        for topic, complaint in player.loose_ends({}):
            raise PlayError(f"{complaint} {rospy.resolve_name(topic)} any more")
    try:
        player.heartbeat = expect_nodes
        player.play(follow_optics=own_lens, rate=rate)
        player.finish()
    except PlayError as error:
        if rospy.is_shutdown():
            raise
        rospy.logwarn("%s: the bag begins anew", error)
    finally:
        player.heartbeat = lambda _: None
    for problem in set(player.problems) - said:
        rospy.logwarn("%s", problem)
    said.update(player.problems)
    player.pause(PAUSE)
    player.rewind()
