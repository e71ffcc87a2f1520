// SPDX-License-Identifier: Apache-2.0
//
// [web] -> WebSettings, for slabd-web. A fault in this table does not concern the inspection: the daemon reports it as
// a doubt and runs, slabd-web does not start, and `slabctl config check` reports it as a fault.
#include <fmt/format.h>

#include <algorithm>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

constexpr std::size_t kNamesMax = 16;
/// Longest host name (RFC 1035, 2.3.4).
constexpr std::size_t kNameBytesMax = 253;

bool is_loopback(std::string_view host) {
  return host.starts_with("127.");
}

/// A host name or an address as browsers send it, without a port.
bool is_host_name(std::string_view name) {
  constexpr std::string_view kAllowed = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-";
  return !name.empty() && name.size() <= kNameBytesMax && name.find_first_not_of(kAllowed) == std::string_view::npos;
}

void read_names(TableReader& web, std::vector<std::string>& out) {
  const TomlValue* list = web.value("names");
  if (list == nullptr) return;
  const auto is_name = [](const TomlValue& item) {
    return item.kind == TomlValue::Kind::text && is_host_name(item.text);
  };
  if (list->kind != TomlValue::Kind::array || list->items.size() > kNamesMax ||
      !std::all_of(list->items.begin(), list->items.end(), is_name)) {
    web.problem("names", fmt::format("found {}, allowed is a list of up to {} host names like \"line-7.example\"",
                                     found(*list), kNamesMax));
    return;
  }
  for (const TomlValue& item : list->items) out.push_back(item.text);
}

/// Rejects a listener that would send results and, later, passwords in clear text over a network.
void check_lan(TableReader& web, const WebSettings& settings) {
  if (settings.tls_cert.empty() != settings.tls_key.empty()) {
    const char* given = settings.tls_cert.empty() ? "tls_key" : "tls_cert";
    web.problem(given, fmt::format("found without {}; allowed are both or neither",
                                   settings.tls_cert.empty() ? "tls_cert" : "tls_key"));
  }
  if (settings.lan.host.empty()) {
    for (const char* key : {"tls_cert", "tls_key", "lan_plain"})
      if (web.has(key)) web.problem(key, "has no effect without lan_listen");
    return;
  }
  const bool is_plain = settings.tls_cert.empty();
  if (is_plain && !settings.lan_plain && !is_loopback(settings.lan.host.view()))
    web.problem("lan_listen", fmt::format("found \"{}:{}\" without tls_cert and tls_key; allowed is an address that "
                                          "begins with 127., a certificate, or lan_plain = true",
                                          settings.lan.host.view(), settings.lan.port));
  if (settings.lan.port == settings.kiosk.port && settings.lan.port != 0 &&
      settings.lan.host.view() == settings.kiosk.host.view())
    web.problem("lan_listen", "found the address of web.listen; allowed is another address or port");
}

}  // namespace

void read_web(TableReader web, const std::string& folder, WebSettings& out) {
  read_endpoint(web, "listen", 0, out.kiosk.host, out.kiosk.port);
  read_endpoint(web, "lan_listen", 0, out.lan.host, out.lan.port);
  const auto read_given_path = [&](std::string_view key, std::string& path) {
    if (web.has(key)) read_path(web, key, folder, path);
  };
  read_given_path("tls_cert", out.tls_cert);
  read_given_path("tls_key", out.tls_key);
  web.optional_boolean("lan_plain", out.lan_plain);
  read_names(web, out.names);
  read_given_path("users_file", out.users_file);
  web.optional_boolean("viewer_login", out.viewer_login);
  if (out.viewer_login && out.users_file.empty())
    web.problem("viewer_login", "found without users_file, so no user could read anything; allowed with users_file");
  std::size_t language = out.language == "zh" ? 1 : 0;
  web.optional_word("language", language, {"en", "zh"});
  out.language = language == 1 ? "zh" : "en";
  read_given_path("slabctl", out.slabctl);
  read_given_path("slabd_plant", out.slabd_plant);
  web.optional_number("answer_s", out.answer_s, {1.0, 60.0});
  web.optional_text("plant_dsn", out.plant_dsn, 1'000);
  check_lan(web, out);
  web.finish();
}

}  // namespace slabd::config
