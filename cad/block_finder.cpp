// SPDX-License-Identifier: Apache-2.0
//
// A block is recognised from its seat: a plane that is inclined by 1:10 to 1:1000 against the slab's top and lies
// between two planes that face each other, the jaws. Every pair of a plane and a direction of the model's planes is
// tried as seat and vertical, and the pair that explains the most features wins. The slab's top, seen from the seat of
// the other row, is inclined too: that pair finds neither shoulders nor end faces, and loses.
//
// Planes are taken by their direction and place, the largest first, so that fillets and chamfers between them do not
// matter. A number that two faces contradict is not guessed: it is missing, with both values as the reason.
#include "cad/block_finder.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace slabd::cad {
namespace {

constexpr double kSlopeMin = 0.9e-3;
constexpr double kSlopeMax = 0.11;
constexpr double kSame_mm = 1e-3;

/// Intersection of a plane with the line o + t d.
double along_line(const ModelFace& plane, const Vec3& n, const Vec3& o, const Vec3& d) {
  return n.dot(plane.p - o) / n.dot(d);
}

/// A plane with the sign of its normal that its place in the block requires.
struct Side {
  const ModelFace* face = nullptr;
  Vec3 n = Vec3::Zero();
  explicit operator bool() const { return face != nullptr; }
};

class BlockSearch {
 public:
  BlockSearch(const FaceList& model, const ModelFace& seat, const Vec3& seat_normal, const Vec3& up,
              double reference_mm)
      : model_(model), seat_(seat), n_(seat_normal), reference_mm_(reference_mm) {
    block_.z = up.dot(n_) < 0.0 ? Vec3(-up) : up;
    block_.y = -(n_ - n_.dot(block_.z) * block_.z).normalized();
    block_.x = block_.y.cross(block_.z);
    along_ = n_.cross(block_.x);
  }

  /// True if it is a block.
  bool search() {
    find_jaws();
    find_casings();
    const int casings = int{!casings_[0].empty()} + int{!casings_[1].empty()};
    const bool jaws = jaw_[0] && jaw_[1];
    if (!jaws && !((jaw_[0] || jaw_[1]) && casings > 0) && casings < 2) return false;
    name("seat", seat_.number);
    place();
    put("cant_ratio", 1.0 / std::tan(std::atan2(n_.cross(block_.z).norm(), n_.dot(block_.z))), {seat_.number});
    block_.values.at("cant_ratio").faces.push_back(0);  // replaced by the slab's top below
    measure_jaws();
    measure_casings();
    find_ends();
    find_shoulders();
    find_top();
    find_edges();
    block_.score += casings + int{jaws} * 2;
    return true;
  }

  [[nodiscard]] FoundBlock take() { return std::move(block_); }

 private:
  void name(const char* word, int face) { block_.names.push_back({word, face}); }
  void put(const char* key, double value, std::vector<int> faces) { block_.values[key] = {value, std::move(faces)}; }
  void lack(const char* key, const std::string& why) { block_.missing[key] = why; }

  /// The largest plane for which `fits(face, n)`; n is its normal, or either normal of a loose face.
  Side largest(const std::function<bool(const ModelFace&, const Vec3&)>& fits) const {
    Side best;
    for (const ModelFace& face : model_.faces) {
      if (face.kind != FaceKind::plane || &face == &seat_) continue;
      if (best && face.area_mm2 <= best.face->area_mm2) continue;
      if (fits(face, face.n))
        best = {&face, face.n};
      else if (!model_.has_sides && fits(face, -face.n))
        best = {&face, -face.n};
    }
    return best;
  }

  void find_jaws() {
    for (const std::size_t side : {0U, 1U}) {
      const double sign = side == 0 ? -1.0 : 1.0;
      const auto is_jaw = [&](const ModelFace& face, const Vec3& n) {
        const Vec3 off = face.centre - seat_.centre;
        const double s = sign * off.dot(along_);
        const double h = off.dot(n_);
        return std::abs(n.dot(block_.x)) < kParallel && n.dot(n_) > 0.015 && n.dot(n_) < 0.875 &&
               sign * n.dot(along_) < 0.0 && s > 60.0 && s < 330.0 && h > -2.0 && h < 110.0 &&
               std::abs(off.dot(block_.x)) < 60.0;
      };
      // A jaw may have a break: the plane that exists at the reference height counts.
      jaw_[side] = largest(
          [&](const ModelFace& face, const Vec3& n) { return is_jaw(face, n) && reaches(face, n_, reference_mm_); });
      if (!jaw_[side]) jaw_[side] = largest(is_jaw);
    }
  }

  /// True if the face has points below and above this height over the seat.
  [[nodiscard]] bool reaches(const ModelFace& face, const Vec3& n, double height_mm) const {
    const auto [low, high] = heights(face, n);
    return low < height_mm && height_mm < high;
  }
  [[nodiscard]] std::pair<double, double> heights(const ModelFace& face, const Vec3& n) const {
    double low = 1e9;
    double high = -1e9;
    for (const Vec3& corner : face.corners) {
      low = std::min(low, n.dot(corner - seat_.p));
      high = std::max(high, n.dot(corner - seat_.p));
    }
    return {low, high};
  }

  struct Bore {
    const ModelFace* face = nullptr;
    double s = 0.0;  ///< along the seat, from its centre of area
    double x = 0.0;
    bool has_rim = false;
    double below_mm = 0.0;  ///< from the upper end of the cylinder to the ring, or to the seat
  };

  /// True if the pieces of this cylinder go all around its axis: a slot ends in two halves.
  [[nodiscard]] bool is_round(const ModelFace& face) const {
    double area = 0.0;
    double low = 1e9;
    double high = -1e9;
    for (const ModelFace& piece : model_.faces) {
      if (piece.kind != FaceKind::cylinder || std::abs(piece.radius_mm - face.radius_mm) > kSame_mm ||
          !parallel(piece.n, face.n))
        continue;
      const Vec3 off = piece.p - face.p;
      if ((off - off.dot(face.n) * face.n).norm() > kSame_mm) continue;
      const auto [from, to] = heights(piece, face.n);
      area += piece.area_mm2;
      low = std::min(low, from);
      high = std::max(high, to);
    }
    constexpr double kShareMin = 0.9;
    return area > kShareMin * 2.0 * kPi * face.radius_mm * (high - low);
  }

  void find_casings() {
    for (const ModelFace& face : model_.faces) {
      if (face.kind != FaceKind::cylinder || face.n.cross(n_).norm() > 1e-3) continue;
      const Vec3 at = face.p + along_line(seat_, n_, face.p, face.n) * face.n - seat_.centre;
      const double depth = (face.centre - seat_.centre).dot(n_);
      if (std::abs(at.dot(block_.x)) > 40.0 || std::abs(depth) > 260.0) continue;
      const double s = at.dot(along_);
      if (std::abs(s) < 30.0 || std::abs(s) > 270.0 || face.radius_mm > 60.0 || face.radius_mm < 4.0) continue;
      if (is_round(face)) casings_[s > 0.0 ? 1 : 0].push_back({&face, s, at.dot(block_.x)});
    }
    // The bore: a hollow cylinder around the axis nearest to the block's middle, one with a flat ring before one
    // without, and of a stepped bore the cylinder that reaches the ring.
    for (std::vector<Bore>& side : casings_) {
      for (Bore& bore : side) {
        double radius = kNoValue;
        const ModelFace* const rim = rim_of(bore, radius);
        bore.has_rim = rim != nullptr;
        const double ring = rim != nullptr ? n_.dot(rim->p - seat_.p) : 0.0;
        bore.below_mm = std::abs(heights(*bore.face, n_).second - ring);
      }
      std::stable_sort(side.begin(), side.end(), [](const Bore& a, const Bore& b) {
        if (std::abs(std::abs(a.x) - std::abs(b.x)) > kSame_mm) return std::abs(a.x) < std::abs(b.x);
        if (a.has_rim != b.has_rim) return a.has_rim;
        if (std::abs(a.below_mm - b.below_mm) > 1.0) return a.below_mm < b.below_mm;
        return a.face->radius_mm < b.face->radius_mm;
      });
      const auto hollow = [&](const Bore& bore) { return bore.face->hollow || !model_.has_sides; };
      const auto first = std::find_if(side.begin(), side.end(), hollow);
      if (first == side.end())
        side.clear();
      else
        std::rotate(side.begin(), first, first + 1);
    }
  }

  /// Place of a jaw along the seat at a height above it, from the seat's centre of area.
  [[nodiscard]] double jaw_s(std::size_t side, double height_mm) const {
    const Side& jaw = jaw_[side];
    return along_line(*jaw.face, jaw.n, seat_.centre + height_mm * n_, along_);
  }

  /// Origin: the middle of the jaws at the reference height, or of the casings; along the rail the middle of the ends,
  /// or of the casings.
  void place() {
    // The centre of area is on the plane only to the accuracy of an integral.
    Vec3 origin = seat_.centre - n_.dot(seat_.centre - seat_.p) * n_;
    double s = 0.0;
    if (jaw_[0] && jaw_[1])
      s = 0.5 * (jaw_s(0, reference_mm_) + jaw_s(1, reference_mm_));
    else if (!casings_[0].empty() && !casings_[1].empty())
      s = 0.5 * (casings_[0].front().s + casings_[1].front().s);
    origin += s * along_;
    end_[0] = end_face(-1.0);
    end_[1] = end_face(1.0);
    if (end_[0] && end_[1])
      origin += 0.5 * (end_x(0, origin) + end_x(1, origin)) * block_.x;
    else if (!casings_[0].empty())
      origin += casings_[0].front().x * block_.x;
    else if (!casings_[1].empty())
      origin += casings_[1].front().x * block_.x;
    block_.origin = origin;
  }

  Side end_face(double sign) const {
    return largest([&](const ModelFace& face, const Vec3& n) {
      const Vec3 off = face.centre - seat_.centre;
      const double x = sign * off.dot(block_.x);
      return std::abs(n.dot(block_.y)) < kParallel && sign * n.dot(block_.x) > 0.7 && n.dot(block_.z) > -kParallel &&
             x > 40.0 && x < 200.0 && std::abs(off.dot(block_.y)) < 150.0 && off.dot(block_.z) > -150.0;
    });
  }
  [[nodiscard]] double end_x(std::size_t side, const Vec3& origin) const {
    return along_line(*end_[side].face, end_[side].n, origin, block_.x);
  }

  void measure_jaws() {
    for (const std::size_t side : {0U, 1U}) {
      const char* const word = side == 0 ? "jaw_inner" : "jaw_outer";
      if (jaw_[side]) name(word, jaw_[side].face->number);
    }
    if (!jaw_[0] || !jaw_[1]) {
      const std::string why = fmt::format("the {} jaw was not found", jaw_[0] ? "outer" : "inner");
      lack("jaw_half_distance_mm", why);
      lack("jaw_angle_deg", why);
      return;
    }
    const std::vector<int> faces = {jaw_[0].face->number, jaw_[1].face->number};
    const auto angle = [&](std::size_t side) {
      const Vec3& n = jaw_[side].n;
      return deg_from_rad(std::atan2(n.cross(n_).norm(), -n.dot(n_)));
    };
    if (std::abs(angle(0) - angle(1)) > 1e-3)
      lack("jaw_angle_deg",
           fmt::format("{:.4f} deg inside and {:.4f} deg outside; a recipe has one angle", angle(0), angle(1)));
    else
      put("jaw_angle_deg", 0.5 * (angle(0) + angle(1)), faces);
    put("jaw_half_distance_mm", 0.5 * (jaw_s(1, reference_mm_) - jaw_s(0, reference_mm_)), faces);
    ++block_.score;
  }

  void measure_casings() {
    std::array<double, 2> s{};
    for (const std::size_t side : {0U, 1U}) {
      if (casings_[side].empty()) continue;
      const Bore& bore = casings_[side].front();
      name(side == 0 ? "casing_inner" : "casing_outer", bore.face->number);
      const Vec3 at = bore.face->p + along_line(seat_, n_, bore.face->p, bore.face->n) * bore.face->n;
      s[side] = (at - block_.origin).dot(along_);
    }
    if (casings_[0].empty() || casings_[1].empty()) {
      const std::string why = casings_[0].empty() && casings_[1].empty()
                                  ? "no casings were found"
                                  : fmt::format("the {} casing was not found", casings_[0].empty() ? "inner" : "outer");
      lack("casing_half_spacing_mm", why);
    } else if (std::abs(s[0] + s[1]) > kSame_mm) {
      lack("casing_half_spacing_mm",
           fmt::format("the casings are at {:.4f} mm and {:.4f} mm from the middle of the jaws; a recipe has them "
                       "symmetric",
                       s[0], s[1]));
    } else {
      put("casing_half_spacing_mm", 0.5 * (s[1] - s[0]),
          {casings_[0].front().face->number, casings_[1].front().face->number});
      ++block_.score;
    }
    both_casings("casing_bore_diameter_mm", [&](const Bore& bore, std::vector<int>& faces) {
      faces.push_back(bore.face->number);
      return 2.0 * bore.face->radius_mm;
    });
    both_casings("casing_rim_diameter_mm", [&](const Bore& bore, std::vector<int>& faces) {
      double radius = kNoValue;
      const ModelFace* const rim = rim_of(bore, radius);
      if (rim != nullptr) faces.push_back(rim->number);
      return 2.0 * radius;
    });
    both_casings("casing_rim_height_mm", [&](const Bore& bore, std::vector<int>& faces) {
      double radius = kNoValue;
      const ModelFace* const rim = rim_of(bore, radius);
      if (rim == nullptr) return kNoValue;
      faces.push_back(rim->number);
      return n_.dot(rim->p - block_.origin);
    });
  }

  /// The flat ring around a bore, parallel to the seat and near its height, and its outer radius.
  const ModelFace* rim_of(const Bore& bore, double& radius) const {
    const ModelFace* best = nullptr;
    for (const ModelFace& face : model_.faces) {
      if (face.kind != FaceKind::plane || &face == &seat_ || !parallel(face.n, n_)) continue;
      if (model_.has_sides && face.n.dot(n_) < 0.0) continue;
      if (std::abs(n_.dot(face.p - seat_.p)) > 12.0) continue;
      double outer = 0.0;
      double inner = 1e9;
      for (const Circle& circle : face.circles) {
        const Vec3 off = circle.centre - bore.face->p;
        if ((off - off.dot(n_) * n_).norm() > kSame_mm) continue;
        outer = std::max(outer, circle.radius_mm);
        inner = std::min(inner, circle.radius_mm);
      }
      if (!(outer > bore.face->radius_mm + 0.01) || outer > 60.0 || inner > outer - 0.01) continue;
      if (best != nullptr && std::abs(n_.dot(best->p - seat_.p)) <= std::abs(n_.dot(face.p - seat_.p))) continue;
      best = &face;
      radius = outer;
    }
    return best;
  }

  void both_casings(const char* key, const std::function<double(const Bore&, std::vector<int>&)>& measure) {
    std::vector<int> faces;
    std::vector<double> values;
    for (const std::vector<Bore>& side : casings_)
      if (!side.empty())
        if (const double value = measure(side.front(), faces); has_value(value)) values.push_back(value);
    if (values.empty()) return lack(key, "no face was found");
    if (values.size() == 1 && !casings_[0].empty() && !casings_[1].empty())
      return lack(key, fmt::format("{:.4f} mm at one casing, and no face at the other", values[0]));
    if (values.size() == 2 && std::abs(values[0] - values[1]) > kSame_mm)
      return lack(key, fmt::format("{:.4f} mm inside and {:.4f} mm outside; a recipe has one", values[0], values[1]));
    put(key, values.front(), faces);
  }

  void find_ends() {
    for (const std::size_t side : {0U, 1U}) {
      const double sign = side == 0 ? -1.0 : 1.0;
      side_[side] = largest([&](const ModelFace& face, const Vec3& n) {
        const Vec3 off = face.centre - block_.origin;
        const double y = sign * off.dot(block_.y);
        return std::abs(n.dot(block_.x)) < kParallel && sign * n.dot(block_.y) > 0.7 && n.dot(block_.z) > -kParallel &&
               y > 100.0 && y < 320.0 && std::abs(off.dot(block_.x)) < 60.0 && off.dot(block_.z) > -150.0;
      });
    }
    const auto draft = [&](const Side& face) {
      return deg_from_rad(std::atan2(face.n.dot(block_.z), face.n.cross(block_.z).norm()));
    };
    std::vector<double> drafts;
    std::vector<int> faces;
    const auto pair = [&](const char* key, const std::array<Side, 2>& sides, const Vec3& axis, const char* word) {
      for (const Side& face : sides)
        if (face) {
          drafts.push_back(draft(face));
          faces.push_back(face.face->number);
        }
      if (!sides[0] || !sides[1]) return lack(key, fmt::format("not both {} were found", word));
      const double low = along_line(*sides[0].face, sides[0].n, block_.origin, axis);
      const double high = along_line(*sides[1].face, sides[1].n, block_.origin, axis);
      if (std::abs(low + high) > kSame_mm)
        return lack(key, fmt::format("the {} are at {:.4f} mm and {:.4f} mm from the origin; a recipe has them "
                                     "symmetric",
                                     word, low, high));
      put(key, 0.5 * (high - low), {sides[0].face->number, sides[1].face->number});
      ++block_.score;
    };
    pair("end_half_length_mm", end_, block_.x, "end faces");
    pair("side_half_width_mm", side_, block_.y, "side faces");
    if (drafts.empty()) return lack("draft_deg", "neither end faces nor side faces were found");
    const auto [low, high] = std::minmax_element(drafts.begin(), drafts.end());
    if (*high - *low > 1e-3)
      return lack("draft_deg", fmt::format("the faces have {:.4f} to {:.4f} deg; a recipe has one draft", *low, *high));
    put("draft_deg", drafts.front(), faces);
  }

  void find_shoulders() {
    for (const std::size_t side : {0U, 1U}) {
      const double sign = side == 0 ? -1.0 : 1.0;
      const char* const key = side == 0 ? "shoulder_inner_z_mm" : "shoulder_outer_z_mm";
      shoulder_[side] = largest([&](const ModelFace& face, const Vec3& n) {
        const Vec3 off = face.centre - block_.origin;
        const double y = sign * off.dot(block_.y);
        const double z = n.dot(face.p - block_.origin) / n.dot(block_.z);
        return n.cross(block_.z).norm() < kParallel && n.dot(block_.z) > 0.0 && y > 90.0 && y < 320.0 && z > 2.0 &&
               z < 110.0 && std::abs(off.dot(block_.x)) < 60.0;
      });
      if (!shoulder_[side]) {
        lack(key, "the shoulder was not found");
        continue;
      }
      put(key, along_line(*shoulder_[side].face, shoulder_[side].n, block_.origin, block_.z),
          {shoulder_[side].face->number});
      ++block_.score;
    }
  }

  /// The slab's top: the highest large face below that looks up. Of a single block it may be the face on which it
  /// rests.
  void find_top() {
    const auto is_level = [&](const ModelFace& face, const Vec3& n, double sign) {
      const double z = height_of(face);
      return n.cross(block_.z).norm() < kParallel && sign * n.dot(block_.z) > 0.0 && z < -3.0 && z > -210.0 &&
             face.area_mm2 > seat_.area_mm2;
    };
    Side top;
    // Wider than any ledge of a block; of two levels the blocks stand on the upper one.
    constexpr double kWide = 3.0;
    for (const ModelFace& face : model_.faces)
      for (const double sign : {1.0, -1.0})
        if (face.kind == FaceKind::plane && face.area_mm2 > kWide * seat_.area_mm2 &&
            (sign > 0.0 || !model_.has_sides) && is_level(face, sign * face.n, 1.0) &&
            (!top || height_of(face) > height_of(*top.face)))
          top = {&face, sign * face.n};
    if (!top) top = largest([&](const ModelFace& face, const Vec3& n) { return is_level(face, n, 1.0); });
    if (!top) {
      // The foot of a block, not the bottom of a slab.
      constexpr double kFootMax_mm2 = 300'000.0;
      top = largest([&](const ModelFace& face, const Vec3& n) {
        return is_level(face, n, -1.0) && face.area_mm2 < kFootMax_mm2;
      });
      block_.top_is_foot = static_cast<bool>(top);
    }
    if (!top) {
      lack("slab_top_z_mm", "no horizontal face 5 to 200 mm below the seat was found");
      block_.values.at("cant_ratio").faces.pop_back();
      return;
    }
    block_.top_face = top.face->number;
    block_.values.at("cant_ratio").faces.back() = block_.top_face;
    put("slab_top_z_mm", along_line(*top.face, top.n, block_.origin, block_.z), {block_.top_face});
    ++block_.score;
  }

  [[nodiscard]] double height_of(const ModelFace& face) const { return (face.p - block_.origin).dot(block_.z); }

  /// Fillets along the rail between the faces that were found, and chamfers at ends and sides.
  void find_edges() {
    std::vector<int> seat_faces;
    std::vector<int> shoulder_faces;
    std::vector<int> chamfer_faces;
    std::vector<double> seat_r;
    std::vector<double> shoulder_r;
    std::vector<double> legs;
    for (const ModelFace& face : model_.faces) {
      const Vec3 off = face.centre - block_.origin;
      if (std::abs(off.dot(block_.x)) > 200.0 || std::abs(off.dot(block_.y)) > 320.0 ||
          std::abs(off.dot(block_.z)) > 120.0)
        continue;
      if (face.kind == FaceKind::cylinder && face.radius_mm < 15.0 && parallel(face.n, block_.x)) {
        const auto touches = [&](const ModelFace* plane, const Vec3& n) {
          return plane != nullptr && std::abs(std::abs(n.dot(face.p - plane->p)) - face.radius_mm) < 0.01;
        };
        for (const std::size_t side : {0U, 1U}) {
          if (!jaw_[side] || !touches(jaw_[side].face, jaw_[side].n)) continue;
          if (touches(&seat_, n_)) {
            seat_r.push_back(face.radius_mm);
            seat_faces.push_back(face.number);
          } else if (shoulder_[side] && touches(shoulder_[side].face, shoulder_[side].n)) {
            shoulder_r.push_back(face.radius_mm);
            shoulder_faces.push_back(face.number);
          }
        }
        if (face.radius_mm >= 0.5) block_.radii_mm.push_back(face.radius_mm);
      }
      if (face.kind != FaceKind::plane) continue;
      for (const auto& [sides, axis] : {std::pair(&end_, block_.x), std::pair(&side_, block_.y)})
        for (const Side& wall : *sides) {
          if (!wall || face.n.dot(block_.z) < 0.3 || face.n.dot(wall.n) < 0.3) continue;
          const Vec3 across = axis.cross(block_.z);
          if (std::abs(face.n.dot(across)) > 0.05 || &face == wall.face) continue;
          if (parallel(face.n, jaw_[0].n) || parallel(face.n, jaw_[1].n) || parallel(face.n, wall.n)) continue;
          const double width = face.area_mm2 / std::max(extent(face, across), 1.0);
          if (width > 25.0 || width < 0.5) continue;
          // Both legs, on the wall and on the shoulder, are equal.
          const double half_turn = 0.5 * std::acos(std::clamp(wall.n.dot(block_.z), -1.0, 1.0));
          const double leg = width / (2.0 * std::cos(half_turn));
          legs.push_back(leg);
          chamfer_faces.push_back(face.number);
          block_.radii_mm.push_back(leg);
        }
    }
    put_edge("edges.fillet_seat_mm", seat_r, seat_faces, 0.01);
    put_edge("edges.fillet_shoulder_mm", shoulder_r, shoulder_faces, 0.01);
    // The width of a chamfer is from its area: mitred corners count.
    put_edge("edges.chamfer_mm", legs, chamfer_faces, 0.1);
  }

  void put_edge(const char* key, const std::vector<double>& values, const std::vector<int>& faces, double same_mm) {
    if (values.empty()) return;
    const auto [low, high] = std::minmax_element(values.begin(), values.end());
    if (*high - *low > same_mm) return lack(key, fmt::format("{:.2f} to {:.2f} mm; a recipe has one", *low, *high));
    put(key, *low, faces);
  }

  static double extent(const ModelFace& face, const Vec3& axis) {
    double low = 1e9;
    double high = -1e9;
    for (const Vec3& p : face.corners) {
      low = std::min(low, p.dot(axis));
      high = std::max(high, p.dot(axis));
    }
    return high - low;
  }

  const FaceList& model_;
  const ModelFace& seat_;
  Vec3 n_;
  double reference_mm_;
  Vec3 along_ = Vec3::Zero();
  std::array<Side, 2> jaw_{};  ///< [inner, outer], as the following
  std::array<Side, 2> end_{};
  std::array<Side, 2> side_{};
  std::array<Side, 2> shoulder_{};
  std::array<std::vector<Bore>, 2> casings_{};
  FoundBlock block_;
};

/// Directions of planes without sign, the largest total area first.
std::vector<Vec3> directions(const FaceList& model) {
  struct Direction {
    Vec3 n;
    double area_mm2;
  };
  std::vector<Direction> list;
  for (const ModelFace& face : model.faces) {
    if (face.kind != FaceKind::plane) continue;
    const auto known =
        std::find_if(list.begin(), list.end(), [&](const Direction& d) { return parallel(d.n, face.n); });
    if (known == list.end())
      list.push_back({face.n, face.area_mm2});
    else
      known->area_mm2 += face.area_mm2;
  }
  std::stable_sort(list.begin(), list.end(),
                   [](const Direction& a, const Direction& b) { return a.area_mm2 > b.area_mm2; });
  constexpr std::size_t kDirectionsMax = 64;
  std::vector<Vec3> out;
  for (const Direction& direction : list)
    if (out.size() < kDirectionsMax) out.push_back(direction.n);
  return out;
}

/// Adds a block. Of two at one place, such as the seat and a rim in it, the one with more features stays.
void add(std::vector<FoundBlock>& blocks, FoundBlock&& block) {
  constexpr double kApart_mm = 200.0;
  for (FoundBlock& other : blocks) {
    if ((other.origin - block.origin).norm() > kApart_mm) continue;
    if (block.score > other.score) other = std::move(block);
    return;
  }
  blocks.push_back(std::move(block));
}

}  // namespace

std::vector<FoundBlock> find_blocks(const FaceList& model, double reference_mm) {
  const std::vector<Vec3> ups = directions(model);
  std::vector<FoundBlock> blocks;
  for (const ModelFace& seat : model.faces) {
    if (seat.kind != FaceKind::plane || seat.area_mm2 < 1'000.0 || seat.area_mm2 > 500'000.0) continue;
    FoundBlock best;
    for (const Vec3& up : ups) {
      const double slope = up.cross(seat.n).norm() / std::abs(up.dot(seat.n));
      if (!(slope > kSlopeMin && slope < kSlopeMax)) continue;
      for (const double sign : {1.0, -1.0}) {
        if (sign < 0.0 && model.has_sides) break;
        BlockSearch search(model, seat, sign * seat.n, up, reference_mm);
        if (!search.search()) continue;
        FoundBlock block = search.take();
        if (block.score > best.score) best = std::move(block);
      }
    }
    // Without the slab's top and without casings it is some other inclined plane between two others.
    constexpr int kScoreMin = 5;
    if (best.score >= kScoreMin && (best.top_face != 0 || best.values.count("casing_bore_diameter_mm") != 0))
      add(blocks, std::move(best));
  }
  return blocks;
}

}  // namespace slabd::cad
