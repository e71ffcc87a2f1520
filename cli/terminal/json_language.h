// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/terminal/say.h"

namespace slabd::cli {

/// Language of the sentences in a JSON document: the option's, else English. The environment does not change a document
/// for programs. Keys, names and numbers are the same in all languages.
[[nodiscard]] inline report::Language json_language(const LanguageOption& option) {
  return option.given == "zh" ? report::Language::zh : report::Language::en;
}

}  // namespace slabd::cli
