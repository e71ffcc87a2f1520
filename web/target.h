// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

/// Request target of HTTP (RFC 9112, 3.2.1) as bytes from outside: a path and the parameters of its query.
namespace slabd::web {

inline constexpr std::size_t kTargetBytesMax = 1'024;
inline constexpr std::size_t kParametersMax = 16;

struct TargetParameter {
  std::string name;
  std::string value;  ///< percent-decoded UTF-8 without control characters
};

struct Target {
  std::string path;  ///< begins with '/'; letters, digits and "_-." between single slashes, and no part "." or ".."
  std::vector<TargetParameter> parameters;  ///< in the order of the query, each name once
};

/// nullopt if the target is longer than kTargetBytesMax, is not of this form, or has more than kParametersMax
/// parameters. A path has no percent-encoding, because no path of slabd-web needs one.
[[nodiscard]] std::optional<Target> parse_target(std::string_view raw);

/// True if the value of a Host field (RFC 9110, 7.2) is one of `names`, with or without a port. Upper and lower case
/// are equal.
[[nodiscard]] bool is_host(std::string_view field, const std::vector<std::string>& names);

/// True if an If-None-Match field (RFC 9110, 13.1.2) contains `etag` (with its quotes), or is "*".
[[nodiscard]] bool has_etag(std::string_view field, std::string_view etag);

}  // namespace slabd::web
