// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace slabd::cli {

/// A proposed number of a recipe and its origin.
struct DraftNumber {
  double value = 0.0;
  std::string source;  ///< one line: file, SHA-256, face
};

/// The number of a key ("block.cant_ratio"); nullopt if it has none, and then the reason.
using DraftLookup = std::function<std::optional<DraftNumber>(std::string_view)>;
using DraftReason = std::function<std::string(std::string_view)>;

/// A recipe as a draft: each proposed number with `confirmed = false` and its `source`, each other one as a comment
/// with the reason. The draft does not check until a person has added the slab type, the limits and what is missing.
/// `head` is the comment at its top, one line each.
[[nodiscard]] std::string draft_text(const std::vector<std::string>& head, const std::string& name,
                                     const DraftLookup& number, const DraftReason& reason);

/// Stops unless a draft may be written to `out`: it must end in .toml, must not be one of `inputs`, and a file that is
/// there must not contain a confirmed number.
void check_draft_path(const std::string& out, const std::vector<std::string>& inputs);

/// At most `bytes` bytes of a text, without half a character at the end.
[[nodiscard]] std::string first_bytes(const std::string& text, std::size_t bytes);

}  // namespace slabd::cli
