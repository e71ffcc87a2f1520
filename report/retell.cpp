// SPDX-License-Identifier: Apache-2.0
#include "report/retell.h"

#include <fmt/core.h>

#include "report/say.h"

namespace slabd::report {

std::string retold_or_quoted(std::string_view text) {
  return retold(text).value_or(text.empty() ? "" : fmt::format("“{}”", text));
}

std::string retold_code(Code code, std::string_view text) {
  const std::string_view english = describe(code);
  if (text.starts_with(english)) text.remove_prefix(english.size());
  if (text.starts_with(": ")) text.remove_prefix(2);
  const std::string_view chinese = meaning(code, Language::zh);
  return text.empty() || text == "-" ? std::string(chinese) : fmt::format("{}：{}", chinese, retold_or_quoted(text));
}

std::string retold_cure(Code code, std::string_view text) {
  return text == cure(code) ? std::string(cure_words(code, Language::zh)) : retold_or_quoted(text);
}

}  // namespace slabd::report
