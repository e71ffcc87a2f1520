// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace slabd::web {

/// slabd.web_words/1: names of items, verdicts and reasons, and units of items, as reports print them. `language`: "en"
/// or "zh".
[[nodiscard]] std::string words_document(const std::string& language);

}  // namespace slabd::web
