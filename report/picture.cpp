// SPDX-License-Identifier: Apache-2.0
//
// Maps of a slab with one colour scale for all blocks, so that blocks can be compared. A scale fitted to each block
// would make a flat seat as colourful as a broken one.
#include <algorithm>
#include <cmath>

#include "report/content.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

std::optional<DrawnMap> unpacked(const PackedMap& packed) {
  if (packed.empty()) return std::nullopt;
  std::optional<std::vector<float>> heights = unpack_map(packed);
  if (!heights) return std::nullopt;
  return DrawnMap{packed.columns, packed.rows, packed.cell_mm, std::move(*heights)};
}

/// Rounds up to 1, 2 or 5 times a power of ten.
double rounded_up(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {1.0, 2.0, 5.0})
    if (value <= step * power * (1.0 + 1e-9)) return step * power;
  return 10.0 * power;
}

/// Limit that holds 99 of 100 cells: of the block with the largest one, or twice that of the median block.
double scale_over(const std::array<std::optional<DrawnMap>, limits::kStationsMax>& maps, bool furthest, double least,
                  double most) {
  std::vector<double> reach;
  for (const std::optional<DrawnMap>& map : maps) {
    if (!map) continue;
    std::vector<float> sizes;
    for (const float height : map->heights_mm)
      if (std::isfinite(height)) sizes.push_back(std::abs(height));
    if (sizes.empty()) continue;
    const auto at = static_cast<std::ptrdiff_t>(0.99 * static_cast<double>(sizes.size() - 1));
    std::nth_element(sizes.begin(), sizes.begin() + at, sizes.end());
    reach.push_back(static_cast<double>(sizes[static_cast<std::size_t>(at)]));
  }
  if (reach.empty()) return least;
  if (furthest)
    return std::clamp(rounded_up(std::max(*std::max_element(reach.begin(), reach.end()), 1e-6)), least, most);
  const auto middle = reach.begin() + static_cast<std::ptrdiff_t>(reach.size() / 2);
  std::nth_element(reach.begin(), middle, reach.end());
  return std::clamp(rounded_up(std::max(2.0 * *middle, 1e-6)), least, most);
}

}  // namespace

Result<std::unique_ptr<SlabPicture>> picture_of(storage::Reader& reader, const storage::SlabRecord& record) {
  auto picture = std::make_unique<SlabPicture>();
  picture->record = &record;
  const SlabHeader& header = record.summary.header;
  std::vector<CalibrationId> ids = {header.calibration_id, header.stations_id, header.scanner_id, header.tie_id};
  for (const SlabArm& arm : header.more_arms)
    ids.insert(ids.end(), {arm.calibration_id, arm.stations_id, arm.scanner_id});
  for (const CalibrationId& id : ids) {
    if (id.empty()) continue;
    auto calibration = reader.calibration(id.view());
    if (!calibration) return calibration.error();
    if (calibration.value()) picture->calibrations.push_back(std::move(*calibration.value()));
  }
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    const auto maps = reader.maps(record.summary.header.key, station, block->attempt.number);
    if (!maps) return maps.error();
    const auto i = static_cast<std::size_t>(station - 1);
    picture->registration[i] = unpacked(maps.value()->registration);
    picture->seat[i] = unpacked(maps.value()->seat);
  }
  // The registration scale covers the block of the worst shape. A seat's defect is small and circled, so the seat
  // scale is that of good seats.
  picture->registration_scale_mm = scale_over(picture->registration, true, 0.05, 2.0);
  picture->seat_scale_mm = scale_over(picture->seat, false, 0.02, 1.0);
  return picture;
}

}  // namespace slabd::report
