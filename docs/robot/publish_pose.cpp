// SPDX-License-Identifier: Apache-2.0
//
// Publishes slabd.flange_pose_t on LCM channel FLANGE_POSE every 4 ms (docs/robot/README.md).
//   lcm-gen -x --cpp-hpath gen flange_pose.lcm && g++ -O2 -Igen publish_pose.cpp -llcm -o publish_pose
//   ./publish_pose ["udpm://239.255.76.67:7667?ttl=0"]
#include <algorithm>
#include <chrono>
#include <lcm/lcm-cpp.hpp>
#include <slabd/flange_pose_t.hpp>
#include <thread>

int main(int argc, char** argv) {
  lcm::LCM lcm(argc > 1 ? argv[1] : "udpm://239.255.76.67:7667?ttl=0");  // once: slabd refuses a second sender
  if (!lcm.good()) return 1;                                             // no route for the multicast group
  slabd::flange_pose_t pose{};
  for (auto next = std::chrono::steady_clock::now();; next += std::chrono::milliseconds(4)) {
    std::this_thread::sleep_until(next);
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    pose.utime = std::chrono::duration_cast<std::chrono::microseconds>(now).count();
    pose.robot_time_us = -1;  // the controller's clock
    pose.seq = (pose.seq + 1) & 0x7FFFFFFF;
    pose.base_id = pose.tool_id = 0;       // $NULLFRAME
    pose.flags = 1 | 2 | 16;               // measured, stopped, emulated; not 16 with a real robot
    const double trans[] = {1.9, 0, 1.2};  // m: ask your controller for the flange in the robot root
    const double quat[] = {0, 1, 0, 0};    // w x y z
    std::copy(trans, trans + 3, pose.trans);
    std::copy(quat, quat + 4, pose.quat);
    if (lcm.publish("FLANGE_POSE", &pose) != 0) return 2;
  }
}
