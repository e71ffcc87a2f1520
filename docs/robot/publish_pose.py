#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Publishes slabd.flange_pose_t on LCM channel FLANGE_POSE every 4 ms, without the lcm module (docs/robot/README.md).
publish_pose.py [GROUP] [PORT] [TTL] [ADDRESS of the card], default 239.255.76.67 7667 0 127.0.0.1"""
import itertools
import socket
import struct
import sys
import time

FINGERPRINT = 0x697DD1C8A06C6E4D  # of hal/robot/flange_pose.lcm, as encode() of the bindings writes it
MEASURED, STOPPED, PROGRAM, EMERGENCY_STOP, EMULATED = 1, 2, 4, 8, 16


def read_robot():  # ask your controller: flange in the robot root, m; quaternion w x y z; clock in us or -1; flags
    return (1.9, 0.0, 1.2), (0.0, 1.0, 0.0, 0.0), -1, MEASURED | STOPPED | EMULATED  # no EMULATED with a real robot


group, port, ttl, card = (sys.argv[1:] + ["239.255.76.67", "7667", "0", "127.0.0.1"][len(sys.argv) - 1:])
link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # one socket: slabd refuses a second sender
link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(ttl))
link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(card))
for seq in itertools.count():
    trans, quat, robot_time, flags = read_robot()
    head = struct.pack(">4sI", b"LC02", seq & 0xFFFFFFFF) + b"FLANGE_POSE\0"
    link.sendto(head + struct.pack(">QqqihhI3d4d", FINGERPRINT, time.time_ns() // 1000, robot_time, seq & 0x7FFFFFFF,
                                   0, 0, flags, *trans, *quat), (group, int(port)))
    time.sleep(0.004)
