// SPDX-License-Identifier: Apache-2.0
#include "emulator/block_drawing.h"

#include "emulator/concrete_scan.h"

namespace slabd::simulate {

Result<DrawnBlock> draw_block(const Recipe& recipe, const StationTruth& station, const Pose& T_scanner_block,
                              const ScannerTraits& traits, std::uint64_t block_seed, std::uint64_t scan_seed,
                              std::vector<float>& xyz) {
  auto surface = BlockSurface::make(recipe, station.block, T_scanner_block, traits.projection);
  if (!surface) return surface.error();
  if (!traits.concrete) {
    ScannerTraits scanner = traits;
    scanner.noise_mm = station.noise_mm;
    scanner.outlier_share = station.outlier_share;
    return DrawnBlock{draw_scan(surface.value(), scanner, scan_seed, xyz), std::nullopt};
  }
  ConcreteScanner scanner;
  scanner.seed = traits.scanner_seed;
  scanner.columns = traits.columns;
  scanner.rows = traits.rows;
  scanner.field_x_mm = traits.field_x_mm;
  scanner.field_y_mm = traits.field_y_mm;
  scanner.organised = traits.organised;
  // A planted defect of this scan's noise or outliers replaces the effect.
  const StationTruth usual;
  if (station.noise_mm != usual.noise_mm) scanner.noise_mm = station.noise_mm;
  if (station.outlier_share != usual.outlier_share) scanner.outlier_share = station.outlier_share;
  ConcreteOrder order;
  order.truth = station.block;
  order.effects = *traits.concrete;
  order.defects = traits.damage;
  order.seed = block_seed;
  ConcreteScan drawn = draw_concrete(recipe, order, T_scanner_block, scanner, scan_seed, xyz);
  return DrawnBlock{drawn.drawn, std::move(drawn.truth)};
}

}  // namespace slabd::simulate
