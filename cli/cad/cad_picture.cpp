// SPDX-License-Identifier: Apache-2.0
//
// Parallel projections from two sides with a depth buffer: triangles of any order and size hide each other correctly.
// Edges are drawn where neighbouring pixels belong to different faces.
#include "cli/cad/cad_picture.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "report/drawing.h"

namespace slabd::cli {
namespace {

using report::Colour;

struct Feature {
  const char* name;
  Colour colour;
};
constexpr std::array<Feature, 6> kFeatures = {{
    {"seat", {0.10, 0.55, 0.30}},
    {"jaw_inner", {0.85, 0.45, 0.05}},
    {"jaw_outer", {0.80, 0.15, 0.15}},
    {"casing_inner", {0.15, 0.35, 0.80}},
    {"casing_outer", {0.50, 0.20, 0.70}},
    {"slab_top", {0.75, 0.80, 0.85}},
}};
constexpr Colour kOther{0.60, 0.58, 0.55};

Colour colour_of(const std::string& name) {
  for (const Feature& feature : kFeatures)
    if (name == feature.name || name.starts_with(std::string(feature.name) + "_")) return feature.colour;
  return kOther;
}

std::uint32_t pixel(const Colour& colour, double light) {
  const auto byte = [&](double c) {
    return static_cast<std::uint32_t>(std::lround(255.0 * std::clamp(c * light, 0.0, 1.0)));
  };
  return 0xff000000U | byte(colour.r) << 16U | byte(colour.g) << 8U | byte(colour.b);
}

class Raster {
 public:
  static constexpr int kWidth = 1'600;
  static constexpr int kHeight = 800;

  Raster() : depth_(kWidth * kHeight, -1e30), face_(kWidth * kHeight, 0), argb_(kWidth * kHeight, 0) {}

  /// Corners: x, y in pixels (y upwards), z towards the viewer.
  void fill(const std::array<Vec3, 3>& t, int face, std::uint32_t colour) {
    const double det = (t[1].x() - t[0].x()) * (t[2].y() - t[0].y()) - (t[2].x() - t[0].x()) * (t[1].y() - t[0].y());
    if (std::abs(det) < 1e-9) return;
    const auto [x_low, x_high] = std::minmax({t[0].x(), t[1].x(), t[2].x()});
    const auto [y_low, y_high] = std::minmax({t[0].y(), t[1].y(), t[2].y()});
    const int x0 = static_cast<int>(std::max(std::floor(x_low), 0.0));
    const int x1 = static_cast<int>(std::min(std::ceil(x_high), kWidth - 1.0));
    const int y0 = static_cast<int>(std::max(std::floor(y_low), 0.0));
    const int y1 = static_cast<int>(std::min(std::ceil(y_high), kHeight - 1.0));
    for (int y = y0; y <= y1; ++y)
      for (int x = x0; x <= x1; ++x) {
        const double px = x + 0.5 - t[0].x();
        const double py = y + 0.5 - t[0].y();
        const double u = (px * (t[2].y() - t[0].y()) - py * (t[2].x() - t[0].x())) / det;
        const double v = (py * (t[1].x() - t[0].x()) - px * (t[1].y() - t[0].y())) / det;
        if (u < 0.0 || v < 0.0 || u + v > 1.0) continue;
        const double z = t[0].z() + u * (t[1].z() - t[0].z()) + v * (t[2].z() - t[0].z());
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        if (z <= depth_[at]) continue;
        depth_[at] = z;
        face_[at] = face;
        argb_[at] = colour;
      }
  }

  void draw_edges() {
    for (int y = 0; y + 1 < kHeight; ++y)
      for (int x = 0; x + 1 < kWidth; ++x) {
        const auto at = static_cast<std::size_t>(y * kWidth + x);
        if (face_[at] != face_[at + 1] || face_[at] != face_[at + kWidth]) argb_[at] = 0xff202020U;
      }
  }

  [[nodiscard]] const std::vector<std::uint32_t>& argb() const { return argb_; }

 private:
  std::vector<double> depth_;
  std::vector<int> face_;
  std::vector<std::uint32_t> argb_;
};

/// Up in the picture: the normal of the slab's top or the seat, from its triangles; away from most of the model.
Vec3 up_of(const CadFindings& findings, const std::map<int, std::string>& names) {
  Vec3 best = Vec3::UnitZ();
  double best_area = 0.0;
  Vec3 middle = Vec3::Zero();
  Vec3 seats = Vec3::Zero();
  double points = 0.0;
  double seat_points = 0.0;
  for (const CadPart& part : findings.parts) {
    const auto named = names.find(part.face);
    const bool is_seat = named != names.end() && named->second.starts_with("seat");
    for (const std::array<Vec3, 3>& t : part.triangles) {
      const Vec3 centre = (t[0] + t[1] + t[2]) / 3.0;
      const Vec3 area = (t[1] - t[0]).cross(t[2] - t[0]);
      middle += centre * area.norm();
      points += area.norm();
      if (!is_seat) continue;
      seats += centre * area.norm();
      seat_points += area.norm();
      if (area.norm() > best_area) {
        best_area = area.norm();
        best = area.normalized();
      }
    }
  }
  if (seat_points > 0.0 && points > 0.0 && best.dot(seats / seat_points - middle / points) < 0.0) best = -best;
  return best;
}

/// The model from 40 degrees above the horizon, with the numbers of its seats.
class View {
 public:
  /// `ahead`: horizontal direction towards the viewer.
  View(const CadFindings& findings, const std::map<int, std::string>& names, const Vec3& up, const Vec3& ahead)
      : towards_(std::cos(rad_from_deg(40.0)) * ahead + std::sin(rad_from_deg(40.0)) * up),
        right_(up.cross(towards_).normalized()),
        above_(towards_.cross(right_)) {
    fit(findings);
    const Vec3 sun = (0.5 * towards_ + 0.8 * up + 0.3 * right_).normalized();
    for (const CadPart& part : findings.parts) {
      const auto named = names.find(part.face);
      const Colour colour = named == names.end() ? kOther : colour_of(named->second);
      Vec3 centre = Vec3::Zero();
      double area = 0.0;
      for (const std::array<Vec3, 3>& t : part.triangles) {
        const Vec3 n = (t[1] - t[0]).cross(t[2] - t[0]);
        if (!(n.norm() > 0.0)) continue;
        const double light = 0.55 + 0.45 * std::abs(n.normalized().dot(sun));
        raster_.fill({at(t[0]), at(t[1]), at(t[2])}, part.face, pixel(colour, light));
        centre += n.norm() * (t[0] + t[1] + t[2]) / 3.0;
        area += n.norm();
      }
      if (named != names.end() && named->second.starts_with("seat") && area > 0.0)
        labels_.push_back({named->second == "seat" ? "seat" : named->second.substr(5), at(centre / area)});
    }
    raster_.draw_edges();
  }

  /// `top`: upper edge of the drawing on the canvas.
  void draw(report::Canvas& canvas, double top, double mm_per_pixel) const {
    canvas.cells(0.0, top, mm_per_pixel * Raster::kWidth, mm_per_pixel * Raster::kHeight, Raster::kWidth,
                 Raster::kHeight, raster_.argb());
    for (const Label& label : labels_)
      canvas.text(label.at.x() * mm_per_pixel, top + (Raster::kHeight - label.at.y()) * mm_per_pixel, label.text,
                  {.size_pt = 9.0, .bold = true, .colour = report::kWhite, .anchor = report::Anchor::centre});
  }

 private:
  struct Label {
    std::string text;
    Vec3 at;
  };

  /// Chooses the scale and the middle.
  void fit(const CadFindings& findings) {
    Vec3 low = Vec3::Constant(1e30);
    Vec3 high = Vec3::Constant(-1e30);
    for (const CadPart& part : findings.parts)
      for (const std::array<Vec3, 3>& t : part.triangles)
        for (const Vec3& p : t) {
          const Vec3 seen(right_.dot(p), above_.dot(p), 0.0);
          low = low.cwiseMin(seen);
          high = high.cwiseMax(seen);
        }
    middle_ = 0.5 * (low + high);
    scale_ = std::min(0.95 * Raster::kWidth / std::max(high.x() - low.x(), 1e-6),
                      0.95 * Raster::kHeight / std::max(high.y() - low.y(), 1e-6));
  }

  [[nodiscard]] Vec3 at(const Vec3& p) const {
    return {0.5 * Raster::kWidth + scale_ * (right_.dot(p) - middle_.x()),
            0.5 * Raster::kHeight + scale_ * (above_.dot(p) - middle_.y()), towards_.dot(p)};
  }

  Vec3 towards_;
  Vec3 right_;
  Vec3 above_;
  Vec3 middle_ = Vec3::Zero();
  double scale_ = 1.0;
  Raster raster_;
  std::vector<Label> labels_;
};

}  // namespace

Status write_cad_picture(const std::string& path, const CadFindings& findings, const std::string& title) {
  std::map<int, std::string> names;
  for (const CadName& named : findings.names) names[named.face] = named.name;
  const Vec3 up = up_of(findings, names);
  const Vec3 side = up.cross(std::abs(up.x()) < 0.9 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY())).normalized();
  const std::array<View, 2> views = {View(findings, names, up, Eigen::AngleAxisd(rad_from_deg(35.0), up) * side),
                                     View(findings, names, up, Eigen::AngleAxisd(rad_from_deg(215.0), up) * side)};

  constexpr double kWidth_mm = 320.0;
  constexpr double kHead_mm = 16.0;
  constexpr double kDrawing_mm = kWidth_mm * Raster::kHeight / Raster::kWidth;
  constexpr double kHeight_mm = kHead_mm + 2.0 * kDrawing_mm;
  return report::write_drawing(path, kWidth_mm, kHeight_mm, 127.0, [&](report::Canvas& canvas) {
    for (std::size_t i = 0; i < views.size(); ++i)
      views[i].draw(canvas, kHead_mm + static_cast<double>(i) * kDrawing_mm, kWidth_mm / Raster::kWidth);
    canvas.text(4.0, 7.0, title, {.size_pt = 11.0, .bold = true});
    double x = 4.0;
    for (const Feature& feature : kFeatures) {
      canvas.rectangle(x, 10.0, 4.0, 4.0, feature.colour, report::kBlack);
      canvas.text(x + 5.5, 13.5, feature.name, {.size_pt = 9.0});
      x += 40.0;
    }
    canvas.rectangle(x, 10.0, 4.0, 4.0, kOther, report::kBlack);
    canvas.text(x + 5.5, 13.5, "not used", {.size_pt = 9.0});
  });
}

}  // namespace slabd::cli
