// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

/// Where the tests and benches find this tree and the programs of this build. One small generated file knows the
/// folders, so that every other object is the same in every clone and can come from the compiler's cache.
namespace slabd::places {

/// The root of the source tree.
[[nodiscard]] std::string source_dir();
/// The programs as they were linked in this build.
[[nodiscard]] std::string slabd();
[[nodiscard]] std::string slabctl();
[[nodiscard]] std::string kuka_bridge();
/// A library for LD_PRELOAD whose malloc() fails now and then; not in builds with sanitizers.
[[nodiscard]] std::string failing_malloc();

}  // namespace slabd::places
