#!/usr/bin/python3
# SPDX-FileCopyrightText: all_in_focus contributors
# SPDX-License-Identifier: BSD-3-Clause
"""With simulated time stamps are the time of arrival, exactly; without a clock there are no images."""
import rospy
from rosgraph_msgs.msg import Clock

from depth_testing import Talker, run_tests, subscribers_of
from kinect_testing import KinectTest, plug


class SimTimeTest(KinectTest):
    def test_stamp_is_the_clock(self):
        clock = Talker('/clock', Clock)
        plug('one')
        depth = self.images('/depth/image_raw')
        self.status('kinect_openni2', 'nobody publishes /clock')
        self.assertFalse(depth.messages)
        clock.wait_for(len(subscribers_of('/clock')))  # this process is one
        for time in (1000.25, 1234.5, 10.125):  # back, as a bag does that starts again
            clock.say(Clock(rospy.Time.from_sec(time)))
            stamps = [message.header.stamp.to_sec() for message in depth.wait(8)]
            self.assertEqual(set(stamps[4:]), {time})


if __name__ == '__main__':
    run_tests(__file__)
