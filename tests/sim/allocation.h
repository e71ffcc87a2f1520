// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// The heap of slabd's side of a simulation: it can run out at the n-th request, and it can be watched for requests
/// where there must be none. What the simulation itself asks for does not count.
namespace slabd::sim::heap {

/// Registers SQLite's share of the heap. Before SQLite is used for the first time.
void take_over();
/// The `count`-th request from now on fails, once. 0: none.
void fail_at(std::int64_t count);
[[nodiscard]] bool failed();
/// Counts requests until `stop`, which returns how many there were.
void watch();
std::uint64_t stop();

/// While one of these lives, a fiber of slabd does the simulation's work. Not over a change of fibers. Outside the
/// fibers it is always the simulation's.
class Aside {
 public:
  Aside();
  ~Aside();
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;
};

}  // namespace slabd::sim::heap
