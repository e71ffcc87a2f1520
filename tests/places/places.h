// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

/// Paths of this source tree and of this build's programs, for tests and benches. Only one small generated file
/// contains the folders, so that all other objects are equal in every clone and can come from the compiler's cache.
namespace slabd::places {

/// Root of the source tree.
[[nodiscard]] std::string source_dir();
/// Programs linked in this build.
[[nodiscard]] std::string slabd();
[[nodiscard]] std::string slabctl();
[[nodiscard]] std::string kuka_bridge();
[[nodiscard]] std::string slabd_web();
[[nodiscard]] std::string slabd_plant();

}  // namespace slabd::places
