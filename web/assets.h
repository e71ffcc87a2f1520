// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string_view>

/// Files of the page (web/page/dist), which are part of the program.
namespace slabd::web {

struct Asset {
  std::string_view name;  ///< "app.js"
  std::string_view bytes;
};

/// Sorted by name; contains index.html.
[[nodiscard]] std::span<const Asset> assets();
/// nullptr if there is none of this name.
[[nodiscard]] const Asset* find_asset(std::string_view name);
/// Media type by the extension of a name.
[[nodiscard]] std::string_view media_type(std::string_view name);

}  // namespace slabd::web
