// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/base.h"
#include "base/result.h"
#include "report/say.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Texts of slabctl in the chosen language (report/say.h). A process runs one command, which chooses the language
/// before its first text; without a choice it is English.
namespace slabd::cli {

/// --language; if it is not given, the environment's SLABD_LANGUAGE, else English.
struct LanguageOption {
  std::string given;

  /// `help`: "Language of the screen".
  void add_to(args::Command& command, const std::string& help);
  /// Stops if SLABD_LANGUAGE is not the name of a language.
  [[nodiscard]] report::Language chosen() const;
};

/// Chooses the language of this process's texts. JSON is the same in all languages.
void set_language(const LanguageOption& option, bool as_json = false);
[[nodiscard]] report::Language language_in_use();

template <typename... T>
[[nodiscard]] std::string say(report::CatalogueText<std::type_identity_t<T>...> text, const T&... values) {
  return report::say(language_in_use(), text, values...);
}
/// The translation of a text that is not a literal.
[[nodiscard]] std::string_view translated(std::string_view english);
/// Marks a literal for the catalogue whose translation is looked up later.
[[nodiscard]] consteval const char* marked(const char* english) {
  return english;
}
/// A text of a lower room, the daemon or the system, which is English: its translation if the catalogue has one,
/// otherwise in Chinese quotes.
[[nodiscard]] std::string quote(std::string_view text);
/// The same without quotes, for a text that may be in the chosen language already.
[[nodiscard]] std::string retold(std::string_view text);
/// A code's text from the daemon: in Chinese the code's meaning, and what the daemon added to it in quotes.
[[nodiscard]] std::string code_text(Code code, std::string_view text);
/// The cure of a code from the daemon, which may have other words than the code.
[[nodiscard]] std::string code_cure(Code code, std::string_view text);
/// The name of a verdict in the chosen language.
[[nodiscard]] std::string_view verdict_name(Verdict verdict);
/// An error with a text in the chosen language.
[[nodiscard]] Error said_error(Code code, const std::string& text);

}  // namespace slabd::cli
