// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace slabd::daemon {

/// "g0a7ddc5", "g0a7ddc5.dirty" or "unknown": the commit this program was built from, determined at every build
/// (script/commit). At most 40 characters. In its own object file, so that a new commit recompiles only that file.
[[nodiscard]] const char* commit();

}  // namespace slabd::daemon
