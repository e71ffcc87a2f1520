// SPDX-License-Identifier: Apache-2.0
#include "cad/slab_finder.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>

namespace slabd::cad {
namespace {

constexpr double kSame_mm = 1e-3;

class SlabSearch {
 public:
  SlabSearch(const FaceList& model, std::vector<FoundBlock>& blocks, Findings& findings)
      : model_(model),
        blocks_(blocks),
        findings_(findings),
        x_(blocks.front().x),
        y_(blocks.front().y),
        z_(blocks.front().z) {}

  void search() {
    order();
    follow_the_rows();
    if (rows_[0].empty() || rows_[1].empty()) {
      findings_.remarks.push_back("all blocks are in one row: the other row of the slab was not found");
    } else if (rows_[0].size() != rows_[1].size()) {
      lack("pairs", fmt::format("the rows have {} and {} blocks", rows_[0].size(), rows_[1].size()));
    } else {
      put("pairs", static_cast<double>(rows_[0].size()), seats(), "number of seats in a row");
    }
    pitch();
    across();
    body();
    compare_places();
  }

 private:
  /// Axes from the places of the blocks: those of one block are turned if it is.
  void follow_the_rows() {
    const std::vector<std::size_t>& row = rows_[0].size() >= rows_[1].size() ? rows_[0] : rows_[1];
    if (row.size() < 2) return;
    Vec3 x = blocks_[row.back()].origin - blocks_[row.front()].origin;
    x -= x.dot(z_) * z_;
    if (x.dot(x_) < 0.0) x = -x;
    x_ = x.normalized();
    y_ = z_.cross(x_);
  }

  /// Names what a recipe cannot say, or says otherwise: blocks that are turned, climb inward, or are not opposite.
  void compare_places() {
    for (std::size_t i = 0; i < blocks_.size(); ++i)
      if (const double turned = blocks_[i].x.cross(x_).norm(); turned > kParallel)
        findings_.remarks.push_back(
            fmt::format("block {} is turned by {:.4f} deg against its row", i + 1, deg_from_rad(std::asin(turned))));
    if (rows_[0].empty() || rows_[1].empty()) return;
    const FoundBlock& first = blocks_[rows_[0].front()];
    const FoundBlock& other = blocks_[rows_[1].front()];
    if ((first.origin - other.origin).dot(first.y) < 0.0)
      findings_.remarks.push_back(
          "the seats climb towards the middle of the slab; those of a recipe climb outward: inner and outer are "
          "exchanged in all numbers");
    for (std::size_t i = 0; i < std::min(rows_[0].size(), rows_[1].size()); ++i) {
      const std::size_t a = rows_[0][i];
      const std::size_t b = rows_[1][rows_[1].size() - 1 - i];
      if (const double off = (blocks_[a].origin - blocks_[b].origin).dot(x_); std::abs(off) > kSame_mm)
        findings_.remarks.push_back(
            fmt::format("blocks {} and {} are {:.4f} mm apart along the slab; in a recipe they are opposite", a + 1,
                        b + 1, std::abs(off)));
    }
  }

  void put(const char* key, double value, std::vector<int> faces, const std::string& note) {
    findings_.found.push_back({std::string("slab.") + key, value, std::move(faces), note});
  }
  void lack(const char* key, const std::string& why) {
    findings_.not_found.push_back({std::string("slab.") + key, why});
  }

  static int seat_of(const FoundBlock& block) { return block.names.front().face; }
  [[nodiscard]] std::vector<int> seats() const {
    std::vector<int> faces;
    for (const FoundBlock& block : blocks_) faces.push_back(seat_of(block));
    return faces;
  }

  /// Stations: the first block's row with increasing X, then the other row with decreasing X.
  void order() {
    std::vector<FoundBlock> left;
    std::vector<FoundBlock> right;
    for (FoundBlock& block : blocks_) (block.y.dot(y_) > 0.0 ? left : right).push_back(std::move(block));
    const auto by_x = [&](const FoundBlock& a, const FoundBlock& b) { return a.origin.dot(x_) < b.origin.dot(x_); };
    std::sort(left.begin(), left.end(), by_x);
    std::sort(right.rbegin(), right.rend(), by_x);
    blocks_ = std::move(left);
    const std::size_t first_row = blocks_.size();
    for (FoundBlock& block : right) blocks_.push_back(std::move(block));
    for (std::size_t i = 0; i < blocks_.size(); ++i) rows_[i < first_row ? 0 : 1].push_back(i);
  }

  void pitch() {
    std::vector<double> steps;
    for (const std::vector<std::size_t>& row : rows_)
      for (std::size_t i = 0; i + 1 < row.size(); ++i)
        steps.push_back(std::abs((blocks_[row[i + 1]].origin - blocks_[row[i]].origin).dot(x_)));
    if (steps.empty()) return lack("pitch_mm", "there is one block in a row");
    const auto [low, high] = std::minmax_element(steps.begin(), steps.end());
    if (*high - *low > kSame_mm) {
      const std::string gap = *high > 1.5 * *low ? "; a block seems to be missing" : "";
      return lack("pitch_mm", fmt::format("neighbours are {:.4f} to {:.4f} mm apart{}", *low, *high, gap));
    }
    const std::vector<std::size_t>& row = rows_[0].size() > 1 ? rows_[0] : rows_[1];
    const double length = (blocks_[row.back()].origin - blocks_[row.front()].origin).dot(x_);
    put("pitch_mm", std::abs(length) / static_cast<double>(row.size() - 1), seats(), "distance of neighbouring seats");
  }

  void across() {
    if (rows_[0].empty() || rows_[1].empty()) return lack("seat_centre_distance_mm", "there is one row of blocks");
    double low = 1e9;
    double high = 0.0;
    for (const std::size_t a : rows_[0])
      for (const std::size_t b : rows_[1]) {
        const double distance = std::abs((blocks_[a].origin - blocks_[b].origin).dot(y_));
        low = std::min(low, distance);
        high = std::max(high, distance);
      }
    if (high - low > kSame_mm)
      return lack("seat_centre_distance_mm", fmt::format("the rows are {:.4f} to {:.4f} mm apart", low, high));
    put("seat_centre_distance_mm", 0.5 * (low + high), seats(), "distance of the rows' seat centres");
  }

  /// The outermost large plane in a direction; nullptr if there is none beyond the blocks.
  [[nodiscard]] const ModelFace* outermost(const Vec3& axis, double beyond_mm) const {
    const ModelFace* best = nullptr;
    for (const ModelFace& face : model_.faces) {
      if (face.kind != FaceKind::plane || std::abs(face.n.dot(axis)) < 0.9) continue;
      if (model_.has_sides && face.n.dot(axis) < 0.0) continue;
      const double at = face.centre.dot(axis);
      if (at < beyond_mm || face.area_mm2 < 20'000.0) continue;
      if (best == nullptr || at > best->centre.dot(axis)) best = &face;
    }
    return best;
  }

  void body() {
    const int top = blocks_.front().top_face;
    if (top == 0) {
      for (const char* key : {"length_mm", "width_mm", "thickness_mm", "first_pair_from_end_mm", "block_origin_z_mm"})
        lack(key, "the slab's top was not found");
      return;
    }
    const auto [lowest, highest] = std::minmax_element(
        blocks_.begin(), blocks_.end(),
        [&](const FoundBlock& a, const FoundBlock& b) { return a.origin.dot(z_) < b.origin.dot(z_); });
    if (const double differ = (highest->origin - lowest->origin).dot(z_); differ > kSame_mm)
      lack("block_origin_z_mm", fmt::format("the seats differ in height by {:.4f} mm", differ));
    else if (const auto z = blocks_.front().values.find("slab_top_z_mm"); z != blocks_.front().values.end())
      put("block_origin_z_mm", -z->second.value, {top}, "height of the seat's middle above the slab's top");
    const Vec3 on_top = blocks_.front().origin + blocks_.front().values.at("slab_top_z_mm").value * z_;
    /// Distance of two outer planes at the height of the slab's top, from the first block's origin.
    const auto size = [&](const char* key, const Vec3& axis, std::array<double, 2>& at, std::vector<int>& faces) {
      for (const std::size_t side : {0U, 1U}) {
        const Vec3 out = side == 0 ? Vec3(-axis) : axis;
        double beyond = -1e9;
        for (const FoundBlock& block : blocks_) beyond = std::max(beyond, block.origin.dot(out));
        const ModelFace* const face = outermost(out, beyond + 20.0);
        if (face == nullptr) {
          lack(key, "the slab's body does not end in planes on both sides");
          return false;
        }
        at[side] = face->n.dot(face->p - on_top) / face->n.dot(axis);
        faces.push_back(face->number);
        if (face->n.cross(axis).norm() > 1e-5)
          findings_.remarks.push_back(fmt::format(
              "slab.{} is taken at the height of the slab's top, because face {} is inclined", key, face->number));
      }
      put(key, at[1] - at[0], faces, "distance of the slab's outer faces");
      return true;
    };
    std::array<double, 2> x{};
    std::array<double, 2> y{};
    std::vector<int> ends;
    std::vector<int> sides;
    const bool has_ends = size("length_mm", x_, x, ends);
    if (size("width_mm", y_, y, sides)) name_rows_off_centre(0.5 * (y[0] + y[1]), on_top);
    const ModelFace* const bottom = outermost(-z_, (-z_).dot(on_top) + 20.0);
    if (bottom == nullptr || bottom->n.cross(z_).norm() > 1e-5)
      lack("thickness_mm", "the slab's body has no bottom that is parallel to its top");
    else
      put("thickness_mm", (on_top - bottom->p).dot(z_), {top, bottom->number}, "distance of top and bottom");
    if (!has_ends) return lack("first_pair_from_end_mm", "the slab's ends were not found");
    double low = 1e9;
    double high = -1e9;
    for (const std::vector<std::size_t>& row : rows_) {
      double first = 1e9;
      double last = -1e9;
      for (const std::size_t i : row) {
        const double at = (blocks_[i].origin - on_top).dot(x_);
        first = std::min(first, at);
        last = std::max(last, at);
      }
      if (row.empty()) continue;
      low = std::min({low, first - x[0], x[1] - last});
      high = std::max({high, first - x[0], x[1] - last});
    }
    if (high - low > kSame_mm)
      return lack("first_pair_from_end_mm",
                  fmt::format("{:.4f} to {:.4f} mm at the ends of the rows; a recipe has one distance", low, high));
    ends.push_back(seat_of(blocks_.front()));
    put("first_pair_from_end_mm", 0.5 * (low + high), ends, "distance of the first seat from the slab's end");
  }

  /// `middle`: of the body's sides, along y from `on_top`.
  void name_rows_off_centre(double middle, const Vec3& on_top) {
    if (rows_[0].empty() || rows_[1].empty()) return;
    const double rows =
        0.5 * (blocks_[rows_[0].front()].origin + blocks_[rows_[1].front()].origin - 2.0 * on_top).dot(y_);
    if (std::abs(rows - middle) > kSame_mm)
      findings_.remarks.push_back(fmt::format(
          "the middle of the rows is {:.4f} mm beside the middle of the slab's sides; a recipe has it in the middle",
          std::abs(rows - middle)));
  }

  const FaceList& model_;
  std::vector<FoundBlock>& blocks_;
  Findings& findings_;
  Vec3 x_;
  Vec3 y_;
  Vec3 z_;
  std::array<std::vector<std::size_t>, 2> rows_{};
};

}  // namespace

void find_slab_values(const FaceList& model, std::vector<FoundBlock>& blocks, Findings& findings) {
  SlabSearch(model, blocks, findings).search();
}

}  // namespace slabd::cad
