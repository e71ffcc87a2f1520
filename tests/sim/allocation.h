// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// The heap of the simulated slabd. It can fail at the N-th request, and requests can be counted where none are
/// allowed. Requests of the simulation itself do not count.
namespace slabd::sim::heap {

/// Registers SQLite's share of the heap. Must be called before SQLite is used for the first time.
void take_over();
/// The `count`-th request from now on fails, once. 0: disabled.
void fail_at(std::int64_t count);
[[nodiscard]] bool failed();
/// Counts requests until `stop`, which returns their number.
void watch();
std::uint64_t stop();

/// During its lifetime a fiber of slabd does work of the simulation. It must not exist across a change of fibers.
/// Outside the fibers all requests belong to the simulation.
class Aside {
 public:
  Aside();
  ~Aside();
  Aside(const Aside&) = delete;
  Aside& operator=(const Aside&) = delete;
};

}  // namespace slabd::sim::heap
