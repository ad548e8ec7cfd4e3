# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the nodes begin and end that publish files in place of a camera."""
import rospy


def run_node(name, publish):
    """Run publish() as a node until the node is to end, or one line has said what is wrong. Returns the exit code."""
    rospy.init_node(name)
    try:
        publish()
    except rospy.ROSException:  # the node is to end
        pass
    except (ValueError, OSError) as error:
        rospy.logfatal("%s", error)
        return 2
    return 0
