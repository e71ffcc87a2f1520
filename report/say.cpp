// SPDX-License-Identifier: Apache-2.0
#include "report/say.h"

#include <fmt/args.h>
#include <fmt/core.h>

#include <algorithm>
#include <vector>

namespace slabd::report {

std::string_view translated(Language language, std::string_view english) {
  if (language == Language::en) return english;
  for (const Translation& entry : catalogue())
    if (entry.english == english) return entry.chinese;
  return english;
}

namespace {

/// The values in place of {} if `text` has the words of `pattern`; nullopt if it has others.
std::optional<std::vector<std::string_view>> values_in(std::string_view text, std::string_view pattern) {
  constexpr std::string_view kPlace = "{}";
  std::vector<std::string_view> values;
  std::size_t place = pattern.find(kPlace);
  if (!text.starts_with(pattern.substr(0, place))) return std::nullopt;
  if (place == std::string_view::npos)
    return text == pattern ? std::optional<std::vector<std::string_view>>(values) : std::nullopt;
  text.remove_prefix(place);
  while (place != std::string_view::npos) {
    pattern.remove_prefix(place + kPlace.size());
    place = pattern.find(kPlace);
    const std::string_view words = pattern.substr(0, place);
    // The last words are the end of the text.
    const bool last = place == std::string_view::npos;
    if (last && !text.ends_with(words)) return std::nullopt;
    const std::size_t end = last ? text.size() - words.size() : text.find(words);
    if (end == std::string_view::npos) return std::nullopt;
    values.push_back(text.substr(0, end));
    text.remove_prefix(end + words.size());
  }
  return values;
}

/// True if a value contains the words after it as well, because the text is a list.
bool is_sentences(std::string_view value) {
  const bool separated = value.find("; ") != std::string_view::npos || value.find(", ") != std::string_view::npos;
  return separated && std::any_of(value.begin(), value.end(), [](char c) { return c >= 'a' && c <= 'z'; });
}

/// The text of an entry with the same words; `exact` if they contain no value.
std::optional<std::string> retold_whole(std::string_view text, bool exact) {
  for (const Translation& entry : lower_catalogue()) {
    const auto values = values_in(text, entry.english);
    if (!values || values->empty() != exact) continue;
    std::vector<std::string> words;
    bool is_list = false;
    for (const std::string_view value : *values) {
      const std::optional<std::string> word = retold(value);
      is_list = is_list || (!word && is_sentences(value));
      words.push_back(word.value_or(std::string(value)));
    }
    if (is_list) continue;
    return filled(entry.chinese, std::vector<SaidValue>(words.begin(), words.end()));
  }
  return std::nullopt;
}

/// The translations of the parts of a list. A part may contain the separator.
std::optional<std::string> retold_list(std::string_view text, std::string_view separator, std::string_view in_chinese) {
  for (std::size_t end = text.find(separator); end != std::string_view::npos; end = text.find(separator, end + 1)) {
    std::optional<std::string> first = retold_whole(text.substr(0, end), true);
    if (!first) first = retold_whole(text.substr(0, end), false);
    const auto rest = first ? retold(text.substr(end + separator.size())) : std::nullopt;
    if (rest) return *first + std::string(in_chinese) + *rest;
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> retold(std::string_view text) {
  if (const auto words = retold_whole(text, true)) return words;
  if (const auto sentence = retold_whole(text, false)) return sentence;
  if (const auto sentences = retold_list(text, "; ", "；")) return sentences;
  return retold_list(text, ", ", "、");
}

std::string filled(std::string_view text, std::span<const SaidValue> values) {
  fmt::dynamic_format_arg_store<fmt::format_context> store;
  for (const SaidValue& value : values) std::visit([&](const auto& of_type) { store.push_back(of_type); }, value);
  return fmt::vformat(text, store);
}

}  // namespace slabd::report
