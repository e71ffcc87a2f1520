// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/result.h"

/// Chinese translations of texts that the daemon and the system compose, for the terminal and the page (report/say.h).
namespace slabd::report {

/// The translation of a text; in Chinese quotes if it is unknown.
[[nodiscard]] std::string retold_or_quoted(std::string_view text);
/// The translation of the daemon's text of a code: the code's meaning, and the daemon's addition to it.
[[nodiscard]] std::string retold_code(Code code, std::string_view text);
/// The translation of the cure of a code from the daemon, which may have other words than the code.
[[nodiscard]] std::string retold_cure(Code code, std::string_view text);

}  // namespace slabd::report
