// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "web/documents.h"
#include "web/live.h"
#include "web/routes.h"
#include "web/sessions.h"
#include "web/target.h"

/// Answers of slabd-web to HTTP requests, without sockets: pages, files of the page, documents, logins, and the writes
/// of quality.
namespace slabd::web {

/// Longest body of a POST.
inline constexpr std::size_t kBodyBytesMax = 8'192;

struct HttpRequest {
  std::string_view method;
  std::string_view target;           ///< as sent
  std::string_view host;             ///< field Host; empty if missing
  std::string_view if_none_match;    ///< empty if missing
  std::string_view accept_language;  ///< the same
  bool has_body = false;
  std::string_view local_address;  ///< IPv4 address that the browser connected to
  std::string_view peer_address;   ///< IPv4 address of the browser
  bool is_tls = false;
  std::string_view cookie;        ///< field Cookie; empty if missing, as the next ones
  std::string_view origin;        ///< field Origin
  std::string_view fetch_site;    ///< field Sec-Fetch-Site
  std::string_view content_type;  ///< field Content-Type
  std::string_view body;          ///< of a POST, at most kBodyBytesMax
  bool is_too_long = false;       ///< the body of a POST is longer, or its length is not given
};

struct HttpReply {
  int status = 200;
  SharedAnswer answer;             ///< its body is not sent with status 304
  bool may_keep = false;           ///< a browser may store the answer, and must ask before it uses it again
  std::string set_cookie{};        ///< field Set-Cookie; empty: none
  std::int64_t retry_after_s = 0;  ///< field Retry-After; 0: none
};

struct SiteSettings {
  std::vector<std::string> names;       ///< host names besides localhost and the address of the connection
  std::string users_file;               ///< accounts; empty: no user can log in, and nothing can be written
  bool viewer_login = false;            ///< documents are given only to users that are logged in
  bool second_person = false;           ///< [quality] second_person, shown to the page
  bool plant = false;                   ///< there is a plant's database, so the page shows its link
  std::vector<std::string> scanners{};  ///< ids of the line's scanners; empty: one without a name
};

/// Names and texts of the JSON object in a POST.
using Fields = std::map<std::string, std::string, std::less<>>;

/// Callable from any thread.
class Site {
 public:
  Site(SiteSettings settings, Documents& documents, Live& live);

  /// Waits for a document at most about three of its time limits.
  [[nodiscard]] HttpReply reply(const HttpRequest& request);
  /// True if the answer to this target may take longer than a second.
  [[nodiscard]] static bool is_slow(std::string_view target);

 private:
  [[nodiscard]] HttpReply in_english(const HttpRequest& request);
  [[nodiscard]] HttpReply read(const HttpRequest& request);
  [[nodiscard]] HttpReply write(const HttpRequest& request);
  [[nodiscard]] HttpReply log_in(const HttpRequest& request, const Fields& fields);
  [[nodiscard]] HttpReply log_out(const HttpRequest& request);
  [[nodiscard]] HttpReply change(const HttpRequest& request, const WriteRequest& wanted, const Fields& fields);
  [[nodiscard]] std::optional<Session> session_of(const HttpRequest& request);
  [[nodiscard]] SharedAnswer session_document(const HttpRequest& request, const std::optional<Session>& session) const;
  [[nodiscard]] bool needs_login(std::string_view path) const;
  [[nodiscard]] SharedAnswer find(const HttpRequest& request, const Target& target);
  [[nodiscard]] SharedAnswer document(const HttpRequest& request, const Target& target);
  [[nodiscard]] SharedAnswer calibration(double cache_s, bool in_chinese);
  [[nodiscard]] std::string checks_of(const std::string& scanner, double cache_s);
  [[nodiscard]] bool is_known_host(const HttpRequest& request) const;

  const SiteSettings settings_;
  Documents& documents_;
  Live& live_;
  Sessions sessions_;
  std::vector<std::pair<std::string_view, SharedAnswer>> files_;  ///< by name
  SharedAnswer words_en_;
  SharedAnswer words_zh_;
};

}  // namespace slabd::web
