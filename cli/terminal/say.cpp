// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/say.h"

#include <fmt/core.h>

#include <cstdlib>

#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "report/retell.h"

namespace slabd::cli {
namespace {

using report::Language;

Language g_language_in_use = Language::en;

}  // namespace

void LanguageOption::add_to(args::Command& command, const std::string& help) {
  command.add_option("--language", given, help + " (default: the environment's SLABD_LANGUAGE, else en)")
      ->check(args::one_of({"en", "zh"}));
}

Language LanguageOption::chosen() const {
  const char* const variable = std::getenv("SLABD_LANGUAGE");
  const std::string name = !given.empty() ? given : variable != nullptr ? variable : "";
  if (!name.empty() && name != "en" && name != "zh")
    stop(kUsage, fmt::format("SLABD_LANGUAGE={}: allowed are en and zh", name));
  return name == "zh" ? Language::zh : Language::en;
}

void set_language(const LanguageOption& option, bool as_json) {
  const Language chosen = option.chosen();
  g_language_in_use = as_json ? Language::en : chosen;
}

Language language_in_use() {
  return g_language_in_use;
}

std::string_view translated(std::string_view english) {
  return report::translated(language_in_use(), english);
}

std::string quote(std::string_view text) {
  if (language_in_use() == Language::en) return std::string(text);
  return report::retold_or_quoted(text);
}

std::string retold(std::string_view text) {
  if (language_in_use() == Language::en) return std::string(text);
  return report::retold(text).value_or(std::string(text));
}

std::string code_text(Code code, std::string_view text) {
  return language_in_use() == Language::en ? std::string(text) : report::retold_code(code, text);
}

std::string code_cure(Code code, std::string_view text) {
  return language_in_use() == Language::en ? std::string(text) : report::retold_cure(code, text);
}

std::string_view verdict_name(Verdict verdict) {
  return language_in_use() == Language::zh ? report::verdict_word(verdict, language_in_use()) : name(verdict);
}

Error said_error(Code code, const std::string& text) {
  return error(code, "%s", text.c_str());
}

}  // namespace slabd::cli
