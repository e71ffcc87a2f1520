// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <variant>

#include "report/words.h"

/// Texts for people in the language that they chose. The English text is the key of the catalogue; values replace its
/// placeholders, in the notation of fmt. A text without a translation remains English.
namespace slabd::report {

using SaidValue = std::variant<std::int64_t, std::uint64_t, double, std::string_view>;

template <typename T>
[[nodiscard]] SaidValue said_value(const T& value) {
  static_assert(!std::is_same_v<T, bool> && !std::is_same_v<T, char>);
  if constexpr (std::unsigned_integral<T>)
    return std::uint64_t{value};
  else if constexpr (std::signed_integral<T>)
    return std::int64_t{value};
  else if constexpr (std::floating_point<T>)
    return double{value};
  else if constexpr (std::convertible_to<const T&, std::string_view>)
    return std::string_view(value);
  else
    return value.view();
}

/// True if the text has one placeholder for each value, and a number's format only for a number.
template <typename... T>
[[nodiscard]] constexpr bool fits(std::string_view text) {
  constexpr std::size_t count = sizeof...(T);
  constexpr std::array<bool, count + 1> is_decimal = {std::is_floating_point_v<T>..., false};
  constexpr std::array<bool, count + 1> is_whole = {std::is_integral_v<T>..., false};
  std::size_t found = 0;
  for (std::size_t open = text.find('{'); open != std::string_view::npos; open = text.find('{', open)) {
    const std::size_t end = text.find('}', open);
    if (end == std::string_view::npos || found == count) return false;
    const std::string_view format = text.substr(open, end - open);
    const bool for_decimal = std::string_view("fge").find(format.back()) != std::string_view::npos;
    const bool for_whole = std::string_view("dxX").find(format.back()) != std::string_view::npos;
    if ((for_decimal && !is_decimal[found]) || (for_whole && !is_whole[found])) return false;
    ++found;
    open = end;
  }
  return found == count;
}

/// A key of the catalogue; its placeholders are compared with the values at compile time.
template <typename... T>
struct CatalogueText {
  consteval CatalogueText(const char* text) : english(text) {  // NOLINT(google-explicit-constructor)
    if (!fits<T...>(english)) throw "the placeholders do not fit the values";
  }
  std::string_view english;
};

struct Translation {
  std::string_view english;
  std::string_view chinese;
};
[[nodiscard]] std::span<const Translation> catalogue();
/// Texts that lower rooms compose, with {} instead of their values.
[[nodiscard]] std::span<const Translation> lower_catalogue();

/// The text in the language, with its placeholders. `english` may be any text.
[[nodiscard]] std::string_view translated(Language language, std::string_view english);
/// The translation of a text that a lower room composed: the entry with the same words, its values translated as well.
/// A list separated by "; " or ", " is translated if all its parts are known. nullopt if the text is unknown.
[[nodiscard]] std::optional<std::string> retold(std::string_view text);
[[nodiscard]] std::string filled(std::string_view text, std::span<const SaidValue> values);

template <typename... T>
[[nodiscard]] std::string say(Language language, CatalogueText<std::type_identity_t<T>...> text, const T&... values) {
  return filled(translated(language, text.english), std::array<SaidValue, sizeof...(T)>{said_value(values)...});
}

}  // namespace slabd::report
