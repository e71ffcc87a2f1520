// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>

#include "base/items.h"
#include "base/limits.h"
#include "base/recipe.h"
#include "base/records.h"
#include "base/result.h"

/// The design of a single slab: how far the seats of a curve slab or a special slab are from the recipe's places.
namespace slabd {

/// One seat: differences from the recipe, in the slab's axes. mm, rad.
struct SeatDesign {
  Vec3 offset_mm = Vec3::Zero();
  double slope_rad = 0.0;  ///< of the whole block about its rail axis; positive: rises further outward
};

struct SlabDesign {
  bool given = false;                                    ///< false: the slab is as the recipe says
  std::array<SeatDesign, limits::kStationsMax> seats{};  ///< [station - 1]

  [[nodiscard]] const SeatDesign& at(int station) const { return seats[static_cast<std::size_t>(station - 1)]; }
};

/// Its rows as text, "station,dx_mm,dy_mm,dz_mm,dslope_deg;", one after the other. This text is stored with a slab, and
/// its SHA-256 identifies the design.
using DesignText = FixedString<1'440>;

/// The sheet of one slab.
struct DesignSheet {
  SlabId slab_id;
  std::uint16_t slab_type = 0;
  std::uint8_t stations = 0;
  FixedString<64> sha256;  ///< of the text, hex
  DesignText text;
};
/// The sheet of the slab; nullptr if there is none. `sheets` are ascending by SLAB_ID.
[[nodiscard]] const DesignSheet* find_design(std::span<const DesignSheet> sheets, std::string_view slab_id);

/// Reads the text. An empty text is the recipe's own slab. config: the text has another form.
[[nodiscard]] Result<SlabDesign> parse_design(std::string_view text);

/// T_slab_block of the recipe, moved by the design. The axes stay those of the recipe: a designed slope belongs to
/// nominals and limits, so that it is reported as a slope.
[[nodiscard]] Pose T_slab_block(const Recipe& recipe, const SlabDesign& design, int station);

/// The block as drawn for this seat: another slope, and the slab's top at another height below it.
[[nodiscard]] BlockGeometry designed_block(const BlockGeometry& block, const SeatDesign& seat);

/// Properties of one slab beside its recipe.
struct SlabFacts {
  double temperature_c = kNoValue;  ///< NaN if unknown
  SlabDesign design;
  GaugeReadings gauges;  ///< known from SLAB_END on; empty while blocks are measured
};

/// blank_item for a slab with this design: nominal and limits are shifted by what the design changes. `station` 0 for a
/// block whose station is not known: as without a design.
[[nodiscard]] Item designed_item(const Recipe& recipe, const SlabDesign& design, ItemId id, int station = 0,
                                 int station_to = 0);

}  // namespace slabd
