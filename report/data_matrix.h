// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string_view>
#include <vector>

namespace slabd::report {

/// A Data Matrix symbol (ISO/IEC 16022, ECC 200), without its quiet zone of one module.
struct DataMatrix {
  std::size_t size = 0;    ///< modules along an edge; 0: no symbol
  std::vector<bool> dark;  ///< row by row from the top

  [[nodiscard]] bool at(std::size_t row, std::size_t column) const { return dark[row * size + column]; }
};

/// The smallest square symbol of the text. No symbol of an empty text or of one that does not fit into 144 x 144.
[[nodiscard]] DataMatrix data_matrix(std::string_view text);

}  // namespace slabd::report
