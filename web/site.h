// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "web/documents.h"
#include "web/live.h"
#include "web/target.h"

/// Answers of slabd-web to HTTP requests, without sockets: pages, files of the page, documents.
namespace slabd::web {

struct HttpRequest {
  std::string_view method;
  std::string_view target;         ///< as sent
  std::string_view host;           ///< field Host; empty if missing
  std::string_view if_none_match;  ///< empty if missing
  bool has_body = false;
  std::string_view local_address;  ///< IPv4 address that the browser connected to
};

struct HttpReply {
  int status = 200;
  SharedAnswer answer;    ///< its body is not sent with status 304
  bool may_keep = false;  ///< a browser may store the answer, and must ask before it uses it again
};

/// Callable from any thread.
class Site {
 public:
  /// `names`: host names besides localhost and the address of the connection.
  Site(std::vector<std::string> names, Documents& documents, Live& live);

  /// Waits for a document at most about three of its time limits.
  [[nodiscard]] HttpReply reply(const HttpRequest& request);
  /// True if the answer to this target may take longer than a second.
  [[nodiscard]] static bool is_slow(std::string_view target);

 private:
  [[nodiscard]] SharedAnswer find(std::string_view target);
  [[nodiscard]] SharedAnswer document(const Target& target);
  [[nodiscard]] SharedAnswer calibration(double cache_s);
  [[nodiscard]] bool is_known_host(const HttpRequest& request) const;

  const std::vector<std::string> names_;
  Documents& documents_;
  Live& live_;
  std::vector<std::pair<std::string_view, SharedAnswer>> files_;  ///< by name
  SharedAnswer words_en_;
  SharedAnswer words_zh_;
};

}  // namespace slabd::web
