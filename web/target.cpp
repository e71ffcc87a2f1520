// SPDX-License-Identifier: Apache-2.0
#include "web/target.h"

#include <algorithm>

#include "base/plain_text.h"

namespace slabd::web {
namespace {

constexpr std::string_view kLetters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";

bool is_path(std::string_view path) {
  if (!path.starts_with('/')) return false;
  if (path == "/") return true;
  while (!path.empty()) {
    path.remove_prefix(1);
    const std::string_view part = path.substr(0, path.find('/'));
    if (part.empty() || part.starts_with('.')) return false;
    if (std::any_of(part.begin(), part.end(), [](char c) { return c != '.' && kLetters.find(c) == kLetters.npos; }))
      return false;
    path.remove_prefix(part.size());
  }
  return true;
}

int hex_value(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> decoded(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '%') {
      out += text[i] == '+' ? ' ' : text[i];
      continue;
    }
    if (text.size() - i < 3) return std::nullopt;
    const int high = hex_value(text[i + 1]);
    const int low = hex_value(text[i + 2]);
    if (high < 0 || low < 0) return std::nullopt;
    out += static_cast<char>(static_cast<unsigned char>(16 * high + low));
    i += 2;
  }
  if (!is_plain(out)) return std::nullopt;
  return out;
}

bool add_parameter(std::string_view pair, std::vector<TargetParameter>& out) {
  const std::size_t equals = pair.find('=');
  const std::string_view name = pair.substr(0, equals);
  if (name.empty() || name.find_first_not_of(kLetters) != std::string_view::npos) return false;
  const auto same = [&](const TargetParameter& other) { return other.name == name; };
  if (out.size() == kParametersMax || std::any_of(out.begin(), out.end(), same)) return false;
  std::optional<std::string> value = decoded(equals == std::string_view::npos ? "" : pair.substr(equals + 1));
  if (!value) return false;
  out.push_back({std::string(name), std::move(*value)});
  return true;
}

std::string_view without_blanks(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

}  // namespace

std::optional<Target> parse_target(std::string_view raw) {
  if (raw.size() > kTargetBytesMax) return std::nullopt;
  const std::size_t question = raw.find('?');
  const std::string_view path = raw.substr(0, question);
  if (!is_path(path)) return std::nullopt;
  Target target{std::string(path), {}};
  if (question == std::string_view::npos) return target;
  std::string_view query = raw.substr(question + 1);
  while (!query.empty()) {
    const std::string_view pair = query.substr(0, query.find('&'));
    if (!add_parameter(pair, target.parameters)) return std::nullopt;
    query.remove_prefix(std::min(query.size(), pair.size() + 1));
  }
  return target;
}

bool is_host(std::string_view field, const std::vector<std::string>& names) {
  field = without_blanks(field);
  if (const std::size_t colon = field.rfind(':'); colon != std::string_view::npos) {
    if (field.substr(colon + 1).find_first_not_of("0123456789") != std::string_view::npos) return false;
    field = field.substr(0, colon);
  }
  return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
    return std::equal(field.begin(), field.end(), name.begin(), name.end(),
                      [](char a, char b) { return lower(a) == lower(b); });
  });
}

bool has_etag(std::string_view field, std::string_view etag) {
  while (!field.empty()) {
    std::string_view tag = field.substr(0, field.find(','));
    field.remove_prefix(std::min(field.size(), tag.size() + 1));
    tag = without_blanks(tag);
    if (tag.starts_with("W/")) tag.remove_prefix(2);
    if (tag == "*" || tag == etag) return true;
  }
  return false;
}

}  // namespace slabd::web
