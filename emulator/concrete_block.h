// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "emulator/block_scene.h"
#include "emulator/concrete_effects.h"
#include "emulator/concrete_fields.h"

/// A supporting block as cast: everything on the concrete, as heights z(x, y) in the block frame, with its truth.
/// block_drawing.h draws the scan of it.
///
/// The code follows the drawing and shares nothing with algo, so that the emulator and the measurement do not share
/// errors. The planes remain the ideal planes of `BlockTruth`: grain and waviness have no mean and no tilt over the
/// region of an item. Pores, burrs, dust and smears are not part of a plane.
namespace slabd::emulator {

// The section x = const of a block: shoulder, jaw, bearing plane, jaw, shoulder as straight lines z(y), with arcs of a
// circle where two of them meet. Exact: a fillet of radius r is a circle that touches both lines.

/// The part of the block that a point of its surface belongs to. `edge`: a fillet or a chamfer.
enum class ConcreteFace : std::uint8_t {
  slab_top,
  end,
  side,
  shoulder_inner,
  shoulder_outer,
  jaw_inner,
  jaw_outer,
  seat,
  edge,
  rim_inner,
  rim_outer,
  cap,
  strap,
  beyond,  ///< beyond the end of the slab: no return
};

struct SectionLine {
  double at_origin = 0.0;
  double per_mm = 0.0;
  [[nodiscard]] double z(double t) const { return at_origin + per_mm * t; }
};

/// An arc between two lines, from its contact with the left one to its contact with the right one. With radius 0 both
/// are the intersection.
struct SectionArc {
  double from = 0.0;
  double to = 0.0;
  double centre_t = 0.0;
  double centre_z = 0.0;
  double radius = 0.0;
  double side = -1.0;  ///< -1: the lower half of the circle (concave corner), +1: the upper (convex corner)

  /// `left` and `right` must not be parallel. The arc is concave if the right line is steeper than the left.
  [[nodiscard]] static SectionArc between(const SectionLine& left, const SectionLine& right, double radius);
  [[nodiscard]] double z(double t) const {
    const double d = t - centre_t;
    return centre_z + side * std::sqrt(std::fmax(0.0, radius * radius - d * d));
  }
};

/// One section. Arcs from the inner shoulder outward: shoulder/jaw, jaw/seat, seat/jaw, jaw/shoulder.
struct Section {
  SectionLine shoulder_inner, jaw_inner, seat, jaw_outer, shoulder_outer;
  std::array<SectionArc, 4> arcs;

  /// Computes the arcs.
  void round(const std::array<double, 4>& radius_mm);
  struct Point {
    double z = 0.0;
    ConcreteFace face = ConcreteFace::seat;
  };
  [[nodiscard]] Point at(double y) const;
};

struct ConcreteOrder {
  BlockTruth truth;  ///< dimensions, and the defects of `DefectKind` that are on the block
  EffectStrengths effects;
  std::vector<ConcreteDefect> defects;
  std::uint64_t seed = 1;
  /// Distance of the nodes of the height field: finer than the pixels of a full scan (0.255 mm). A fillet of 4 mm is
  /// within 0.002 mm of its circle between two nodes. A coarser grid is faster.
  double node_mm = 0.25;
};

/// The basis with deviations of up to `strength` times half of the recipe's tolerances (effect `cast`). mm, rad.
[[nodiscard]] BlockTruth scattered_truth(const Recipe& recipe, const BlockTruth& basis, double strength,
                                         std::uint64_t seed);
/// The basis with those defects of the list that change a dimension.
[[nodiscard]] BlockTruth with_defects(const BlockTruth& basis, const std::vector<ConcreteDefect>& defects);

enum class MarkKind : std::uint8_t { pore, burr, grain_of_dust, drop, damage, crack };
[[nodiscard]] std::string_view name(MarkKind kind);

/// A mark that was planted on the block or broken out of it. Block frame, mm.
struct PlantedMark {
  MarkKind kind = MarkKind::pore;
  double x_mm = 0.0;
  double y_mm = 0.0;
  double z_mm = 0.0;       ///< of the surface without the mark
  double length_mm = 0.0;  ///< along the rail
  double width_mm = 0.0;
  double depth_mm = 0.0;  ///< largest distance from the surface, positive inward, negative outward
  bool in_crop = false;   ///< centre in the evaluation region
};

struct ConcreteTruth {
  BlockTruth block;  ///< dimensions with scatter and defects
  double casing_spacing_mm = 0.0;
  /// Peak to valley of the means of `evaluation.cell_mm` cells in the evaluation region relative to their
  /// least-squares plane, for the noise-free surface. Raw: with all marks; form: without pores, burrs, fin, dust and
  /// drops.
  double flatness_raw_mm = 0.0;
  double flatness_form_mm = 0.0;
  double raw_low_mm = 0.0;  ///< lowest and highest cell of the raw surface
  double raw_high_mm = 0.0;
  /// Mean radii: inner jaw/shoulder, inner seat/jaw, outer seat/jaw, outer jaw/shoulder, slab top. 0: sharp.
  std::array<double, 5> fillet_mm{};
  double chamfer_mm = 0.0;
  double roll_rad = 0.0;                ///< of the bearing plane about Y
  std::array<double, 2> rim_covered{};  ///< share of the rim under slurry, inner and outer
  std::vector<PlantedMark> marks;
  /// The true value in the item's unit; NaN for items that one block does not determine. The flatness is that of the
  /// form.
  [[nodiscard]] double value(ItemId id) const;
};

/// A casing: its rim, its bore and the content of the bore.
struct Bore {
  enum class Content : std::uint8_t { empty, plug, sand, water, cap };
  Vec3 centre = Vec3::Zero();  ///< of the rim, block frame
  Vec3 axis = Vec3::UnitZ();   ///< up
  double radius_mm = 15.0;
  double chamfer_mm = 0.0;  ///< of the bore's edge, outward and down from the rim
  Content content = Content::empty;
  double level_mm = 0.0;         ///< of the content, below the rim
  double thread_depth_mm = 0.0;  ///< depth down to which the wall returns; 0: no return
};

/// Reflection of the surface at a point, as bits.
inline constexpr std::uint8_t kWet = 1;     ///< mostly no return
inline constexpr std::uint8_t kGlossy = 2;  ///< noisy
inline constexpr std::uint8_t kClump = 4;   ///< no return

class ConcreteBlock {
 public:
  /// Half sizes of the height field: larger than the field of view at the slab top, tilted and off centre.
  static constexpr double kHalfX_mm = 220.0;
  static constexpr double kHalfY_mm = 315.0;

  /// Takes about 0.5 s. The same order gives the same bits.
  [[nodiscard]] static ConcreteBlock cast(const Recipe& recipe, const ConcreteOrder& order);

  [[nodiscard]] const HeightField& field() const { return field_; }
  [[nodiscard]] const ConcreteTruth& truth() const { return truth_; }
  [[nodiscard]] ConcreteFace face(std::size_t node) const { return face_[node]; }
  [[nodiscard]] std::uint8_t gloss(std::size_t node) const { return gloss_[node]; }
  [[nodiscard]] const std::array<Bore, 2>& bores() const { return bores_; }
  /// Sharp corners of seat and jaw, inner and outer, at x = 0: y and z.
  [[nodiscard]] const std::array<Vec3, 2>& jaw_corners() const { return jaw_corners_; }

  /// Removes mean and tilt of the slab top's relief over its part that `seen` selects (block frame, called every 2
  /// mm). Otherwise the relief would shift the local slope datum.
  void level_top(const std::function<bool(double x_mm, double y_mm)>& seen);

 private:
  explicit ConcreteBlock(const Recipe& recipe, const ConcreteOrder& order);
  struct Faces;
  /// A node of the height field before `added` is applied along the face's normal.
  struct Node {
    double z = 0.0;
    double added = 0.0;
    ConcreteFace face = ConcreteFace::slab_top;
  };

  [[nodiscard]] std::uint64_t seed_of(Effect effect, std::uint64_t which = 0) const;
  [[nodiscard]] double strength(Effect effect) const { return order_.effects[effect]; }
  /// Standard deviation of the relief at strength 1.
  static constexpr double kRelief_mm = 0.15;

  [[nodiscard]] double seat_z(double x_mm, double y_mm) const;
  /// Coordinate s of the point on the bearing plane over (x, y).
  [[nodiscard]] double along_seat(double x_mm, double y_mm) const;
  [[nodiscard]] bool over_rim(double x_mm, double y_mm, double margin_mm) const;

  void cast_faces();  ///< concrete_faces.cpp
  void shape(Faces& f);
  void round_edges(Faces& f);
  void texture(Faces& f);
  [[nodiscard]] Node block_node(const Faces& f, std::size_t column, std::size_t row) const;
  void round_foot(const Faces& f, std::size_t column, std::size_t row, Node& node) const;
  void remove_planes(std::vector<float>& added) const;
  void set_rims();  ///< concrete_casing.cpp
  void set_rim(std::size_t side);
  void cover_rim(std::size_t side, double share);
  void drop_rim(std::size_t side, double share);
  void fill_bore(std::size_t side);
  void put_defects();  ///< concrete_damage.cpp: form first, then damage
  void put_damage();
  struct Break;
  void chip_corner(const Break& b);
  void chip_seat(const Break& b);
  void chip_jaw(const Break& b);
  void crack(const Break& b);
  void crust(const Break& b);
  void put_form();   ///< concrete_damage.cpp: film, chalk, straps
  void put_marks();  ///< pores, burrs, fin, dust, drops
  void put_pores();
  void put_burrs();
  void put_fin(Effect effect);
  void put_strap(Effect effect);
  void put_dust();
  void put_drops();
  void mark(PlantedMark mark);
  struct Flatness {
    double low = 0.0, high = 0.0;
  };
  [[nodiscard]] Flatness flatness() const;

  /// Adds `height(dx, dy)` to the nodes within `half_mm` of (x, y), except plastic faces.
  template <typename Height>
  void stamp(double x, double y, double half_mm, const Height& height);
  /// Lowers the concrete within `half_mm` of (x, y) to `floor(dx, dy)` where it is higher.
  template <typename Floor>
  void break_out(double x, double y, double half_mm, const Floor& floor);

  const Recipe recipe_;
  const ConcreteOrder order_;
  HeightField field_;
  std::vector<ConcreteFace> face_;
  std::vector<std::uint8_t> gloss_;
  ConcreteTruth truth_;
  std::array<Bore, 2> bores_;
  std::array<Vec3, 2> jaw_corners_;
  RasterField relief_;
  double top_z_mm_ = 0.0;
  double seat_per_y_ = 0.0;  ///< tan of slope and roll
  double seat_per_x_ = 0.0;
};

template <typename Height>
void ConcreteBlock::stamp(double x, double y, double half_mm, const Height& height) {
  const HeightField::Window w = field_.window(x, y, half_mm);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      if (face_[node] >= ConcreteFace::rim_inner) continue;
      field_.z(node) += static_cast<float>(height(field_.x_mm(column) - x, field_.y_mm(row) - y));
    }
}

}  // namespace slabd::emulator
