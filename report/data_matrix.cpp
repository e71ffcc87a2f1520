// SPDX-License-Identifier: Apache-2.0
#include "report/data_matrix.h"

#include <dmtx.h>

#include <memory>
#include <string>

namespace slabd::report {
namespace {

struct Destroy {
  void operator()(DmtxEncode* encoder) const { dmtxEncodeDestroy(&encoder); }
};

}  // namespace

DataMatrix data_matrix(std::string_view text) {
  DataMatrix symbol;
  const std::unique_ptr<DmtxEncode, Destroy> encoder(dmtxEncodeCreate());
  if (encoder == nullptr || text.empty()) return symbol;
  dmtxEncodeSetProp(encoder.get(), DmtxPropScheme, DmtxSchemeAscii);
  dmtxEncodeSetProp(encoder.get(), DmtxPropSizeRequest, DmtxSymbolSquareAuto);
  std::string bytes(text);  // the library does not take constant bytes
  if (dmtxEncodeDataMatrix(encoder.get(), static_cast<int>(bytes.size()),
                           reinterpret_cast<unsigned char*>(bytes.data())) != DmtxPass)
    return symbol;
  symbol.size = static_cast<std::size_t>(encoder->region.symbolRows);
  symbol.dark.reserve(symbol.size * symbol.size);
  // The library counts rows from the bottom.
  for (int row = encoder->region.symbolRows - 1; row >= 0; --row)
    for (int column = 0; column < encoder->region.symbolCols; ++column)
      symbol.dark.push_back(
          (dmtxSymbolModuleStatus(encoder->message, encoder->region.sizeIdx, row, column) & DmtxModuleOnRGB) != 0);
  return symbol;
}

}  // namespace slabd::report
