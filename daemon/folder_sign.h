// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace slabd::daemon {

/// Text that changes when a file of the folder is added, removed, replaced or written: names, numbers, sizes and times.
/// A folder that cannot be read has a sign too.
[[nodiscard]] std::string folder_sign(const std::string& dir);

}  // namespace slabd::daemon
