// SPDX-License-Identifier: Apache-2.0
//
// Input: the target of an HTTP request, and after a line end the fields Host, If-None-Match and Cookie.
#include <algorithm>

#include "tests/fuzz/fuzz.h"
#include "web/routes.h"
#include "web/sessions.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;       // NOLINT(google-build-using-namespace)
  using namespace slabd::web;  // NOLINT(google-build-using-namespace)
  const std::string_view input = fuzz::text_of(data, size);
  const std::string_view raw = input.substr(0, input.find('\n'));
  const std::string_view field = input.substr(std::min(input.size(), raw.size() + 1));
  static const std::vector<std::string> kNames = {"localhost", "127.0.0.1"};
  if (is_host(field, kNames))
    fuzz::must(field.size() < 40 || field.find(' ') != field.npos, "a host is one of the names");
  static_cast<void>(has_etag(field, "\"0123\""));
  fuzz::must(cookie_in(field, "slabd_session").find(';') == std::string_view::npos, "a cookie ends at its semicolon");
  const auto target = parse_target(raw);
  if (!target) return 0;
  fuzz::must(target->path.front() == '/' && target->path.find("..") == target->path.npos, "a path is plain");
  fuzz::must(target->path.find('%') == target->path.npos, "a path has no escapes");
  static_cast<void>(is_page(target->path));
  if (const auto write = find_write(*target); write && !write->key.empty())
    fuzz::must(write->key.starts_with("key:") && write->key.size() < 23, "a slab is written to by its key");
  const auto found = find_document(*target);
  const auto* const request = std::get_if<Request>(&found);
  if (request == nullptr) {
    fuzz::must(!std::get_if<Refusal>(&found)->text.empty(), "a refusal has a reason");
    return 0;
  }
  // A value is either in an option of the table, or behind "--".
  bool positional = false;
  for (std::size_t i = 0; i < request->arguments.size(); ++i) {
    const std::string& word = request->arguments[i];
    fuzz::must(!word.empty() && word.find('\0') == word.npos, "a word can be an argument");
    if (positional) fuzz::must(!word.starts_with('-'), "a value is not an option");
    if (!positional && word.starts_with("--") && word.size() > 2)
      fuzz::must(word.find_first_not_of("abcdefghijklmnopqrstuvwxyz-") == word.npos || word.find('=') != word.npos,
                 "an option is one of the table");
    positional = positional || word == "--";
  }
  for (const char* banned : {"--db", "--config", "--out="})
    for (const std::string& word : request->arguments)
      fuzz::must(!word.starts_with(banned) || word == "--out={file}", "a browser chooses no file");
  return 0;
}
