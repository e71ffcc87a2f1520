// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "base/os.h"

/// HTTP as a browser speaks it, without a library, so that a test can also send what no library would.
namespace slabd::web {

struct Reply {
  int status = 0;                             ///< 0: the connection was closed without an answer
  std::map<std::string, std::string> fields;  ///< names in lower case
  std::string body;

  [[nodiscard]] std::string field(const std::string& name) const;
};

/// Connects to 127.0.0.1; not open if the connection is refused.
[[nodiscard]] Fd connected_to(std::uint16_t port);
/// Reads until the other side closes, at most a minute.
[[nodiscard]] std::string rest_of(const Fd& socket);
/// Sends the bytes and reads until the other side closes.
[[nodiscard]] Reply ask(std::uint16_t port, const std::string& request);
/// GET with the right Host and `fields` ("Name: value\r\n"), without keep-alive.
[[nodiscard]] Reply get(std::uint16_t port, const std::string& target, const std::string& fields = "");
[[nodiscard]] Reply parsed(const std::string& bytes);

}  // namespace slabd::web
