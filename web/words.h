// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

/// Texts of documents in the language of the page. Keys, names and numbers are the same in all languages.
namespace slabd::web {

/// slabd.web_words/1: names of items, verdicts and reasons, and units of items, as reports print them. `language`: "en"
/// or "zh".
[[nodiscard]] std::string words_document(const std::string& language);

/// The JSON text of slabd.status/1 with its sentences in Chinese: fault and cure, warnings, troubles of the links, and
/// notes of the calibration. A text that has no translation stays, in quotes where it follows a translated one.
[[nodiscard]] std::string status_in_chinese(const std::string& status);
/// A JSON text with its fields "note" in Chinese; "null" if it is not one.
[[nodiscard]] std::string notes_in_chinese(const std::string& document);
/// A row of slabd.yield/1, as a JSON text, with its main_reason in Chinese.
[[nodiscard]] std::string yield_in_chinese(const std::string& row);
/// A sentence of slabd-web or of slabctl; unchanged if it has no translation.
[[nodiscard]] std::string sentence_in_chinese(const std::string& sentence);

}  // namespace slabd::web
