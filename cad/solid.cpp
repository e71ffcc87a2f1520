// SPDX-License-Identifier: Apache-2.0
//
// A block is a profile across the rail between two inclined end faces, as in algo/block_model.cpp: seven planes along
// the rail, two end faces, and the slab's top below. The polygons of all blocks and of the slab's body are sewn to one
// closed solid; the casings are then cut in as real cylinders. Planes and cylinders stay analytic, so the numbers of
// the recipe are in the file with all their digits.
//
// Names are found again by geometry after the cut: the plane or the axis, and the place of the block.
#include "cad/solid.h"

#include <BRepAdaptor_Surface.hxx>
#include <BRepAlgoAPI_Cut.hxx>
#include <BRepAlgoAPI_Fuse.hxx>
#include <BRepBuilderAPI_MakeFace.hxx>
#include <BRepBuilderAPI_MakePolygon.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepCheck_Analyzer.hxx>
#include <BRepGProp.hxx>
#include <BRepLib.hxx>
#include <BRepPrimAPI_MakeCylinder.hxx>
#include <GProp_GProps.hxx>
#include <TopExp_Explorer.hxx>
#include <TopTools_ListOfShape.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Solid.hxx>
#include <gp_Ax2.hxx>
#include <gp_Cylinder.hxx>
#include <gp_Pln.hxx>

#include <array>
#include <cmath>
#include <vector>

namespace slabd::cad {
namespace {

/// Depth of a drawn bore, as a share of the block's height; the STL model has the same.
constexpr double kBoreShown = 0.6;

gp_Pnt point(const Vec3& p) {
  return {p.x(), p.y(), p.z()};
}
gp_Dir direction(const Vec3& d) {
  return {d.x(), d.y(), d.z()};
}
Vec3 vector(const gp_XYZ& v) {
  return {v.X(), v.Y(), v.Z()};
}

/// A line across the rail in the section x = 0: ny y + nz z = d.
struct Line {
  double ny = 0.0;
  double nz = 1.0;
  double d = 0.0;
};

struct Corner {
  double y = 0.0;
  double z = 0.0;
};

Corner meet(const Line& a, const Line& b) {
  const double det = a.ny * b.nz - b.ny * a.nz;
  return {(a.d * b.nz - b.d * a.nz) / det, (a.ny * b.d - b.ny * a.d) / det};
}

/// A block's numbers in the form in which it is drawn; all in the block's frame.
class Profile {
 public:
  explicit Profile(const BlockGeometry& g) : g_(g) {
    const double cant = std::atan(1.0 / g.cant_ratio.value);
    along_ = Vec3(0.0, std::cos(cant), std::sin(cant));
    normal_ = Vec3(0.0, -std::sin(cant), std::cos(cant));
    const Line seat{normal_.y(), normal_.z(), 0.0};
    const Line top{0.0, 1.0, g.slab_top_z_mm.value};
    const auto side = [&](double sign) {
      const double c = std::cos(g.draft_rad.value);
      return Line{sign * c, std::sin(g.draft_rad.value), c * g.side_half_width_mm.value};
    };
    const auto jaw = [&](double sign) {
      const Vec3 n = -std::sin(g.jaw_angle_rad.value) * sign * along_ - std::cos(g.jaw_angle_rad.value) * normal_;
      const Vec3 foot = sign * g.jaw_half_distance_mm.value * along_ + g.jaw_reference_height_mm.value * normal_;
      return Line{n.y(), n.z(), n.dot(foot)};
    };
    const Line shoulder_inner{0.0, 1.0, g.shoulder_inner_z_mm.value};
    const Line shoulder_outer{0.0, 1.0, g.shoulder_outer_z_mm.value};
    corners_ = {
        meet(side(-1.0), top), meet(side(-1.0), shoulder_inner), meet(shoulder_inner, jaw(-1.0)), meet(jaw(-1.0), seat),
        meet(jaw(1.0), seat),  meet(shoulder_outer, jaw(1.0)),   meet(side(1.0), shoulder_outer), meet(side(1.0), top)};
  }

  static constexpr std::size_t kCorners = 8;
  [[nodiscard]] const std::array<Corner, kCorners>& corners() const { return corners_; }
  [[nodiscard]] const Vec3& along() const { return along_; }
  [[nodiscard]] const Vec3& normal() const { return normal_; }
  /// Corner on the end face at negative (sign -1) or positive x.
  [[nodiscard]] Vec3 at(std::size_t corner, double sign) const {
    const Corner& c = corners_[corner];
    return {sign * (g_.end_half_length_mm.value - c.z * std::tan(g_.draft_rad.value)), c.y, c.z};
  }

  [[nodiscard]] Status check(const std::string& suffix) const {
    const auto fault = [&](const char* what) {
      return error(Code::config, "block%s cannot be drawn: %s", suffix.c_str(), what);
    };
    for (std::size_t i = 0; i + 1 < kCorners; ++i)
      if (!(corners_[i].y < corners_[i + 1].y)) return fault("the corners of its profile do not go outward");
    for (std::size_t i = 0; i < kCorners; ++i)
      if (!(at(i, 1.0).x() > 1.0)) return fault("its end faces meet");
    const double rim = 0.5 * g_.casing_rim_diameter_mm.value;
    const double centre = g_.casing_half_spacing_mm.value;
    const double seat_half =
        std::min(std::hypot(corners_[3].y, corners_[3].z), std::hypot(corners_[4].y, corners_[4].z));
    if (!(rim < at(4, 1.0).x() && centre > rim && centre + rim < seat_half))
      return fault("its casings are not on the seat");
    if (!(g_.casing_bore_diameter_mm.value < g_.casing_rim_diameter_mm.value))
      return fault("a casing's bore is not smaller than its rim");
    return success();
  }

 private:
  BlockGeometry g_;
  Vec3 along_;
  Vec3 normal_;
  std::array<Corner, kCorners> corners_{};
};

using Polygon = std::vector<Vec3>;

TopoDS_Wire wire_of(const Polygon& polygon) {
  BRepBuilderAPI_MakePolygon wire;
  for (const Vec3& p : polygon) wire.Add(point(p));
  wire.Close();
  return wire.Wire();
}

/// Plane of the polygon whose numbers are those of `n` and the first corner, not those of three corners.
TopoDS_Face face_of(const Polygon& polygon, const Vec3& n, const std::vector<Polygon>& holes = {}) {
  BRepBuilderAPI_MakeFace face(gp_Pln(point(polygon.front()), direction(n)), wire_of(polygon), Standard_True);
  for (const Polygon& hole : holes) face.Add(TopoDS::Wire(wire_of(hole).Reversed()));
  return face.Face();
}

Vec3 normal_of(const Polygon& polygon) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t i = 0; i < polygon.size(); ++i) sum += polygon[i].cross(polygon[(i + 1) % polygon.size()]);
  return sum.normalized();
}

/// Expected place of a named face.
struct Name {
  std::string name;
  Vec3 p;                  ///< on the plane or the axis, near the face's centre
  Vec3 n;                  ///< normal or axis
  double radius_mm = 0.0;  ///< of a cylinder; 0 for a plane
  double reach_mm = 0.0;   ///< distance of the face's centre from p, at most
};

class Builder {
 public:
  explicit Builder(const ModelOrder& order) : order_(order) {}

  Status build(TopoDS_Shape& solid) {
    std::vector<Polygon> feet;
    for (const OrderedBlock& block : order_.blocks) {
      const Profile profile(block.geometry);
      if (Status drawable = profile.check(block.suffix); !drawable) return drawable;
      feet.push_back(add_block(block, profile));
    }
    if (order_.has_slab) {
      if (Status placed = add_body(feet); !placed) return placed;
    } else if (order_.blocks.size() == 1) {
      sewing_.Add(face_of(feet.front(), -normal_of(feet.front())));
      names_.push_back({"slab_top", centre_of(feet.front()), Vec3::UnitZ(), 0.0, 500.0});
    } else {
      return error(Code::config, "the order has several blocks without a slab");
    }
    sewing_.Perform();
    const TopoDS_Shape& sewn = sewing_.SewedShape();
    TopExp_Explorer shells(sewn, TopAbs_SHELL);
    if (!shells.More()) return error(Code::config, "the faces do not close to a solid");
    TopoDS_Solid body = BRepBuilderAPI_MakeSolid(TopoDS::Shell(shells.Current())).Solid();
    if (!BRepLib::OrientClosedSolid(body)) return error(Code::config, "the faces do not close to a solid");
    solid = body;
    return cut_casings(solid);
  }

  void find_names(const TopoDS_Shape& solid, std::map<std::string, TopoDS_Shape>& faces) const {
    for (TopExp_Explorer at(solid, TopAbs_FACE); at.More(); at.Next()) {
      const TopoDS_Face face = TopoDS::Face(at.Current());
      const BRepAdaptor_Surface surface(face);
      GProp_GProps properties;
      BRepGProp::SurfaceProperties(face, properties);
      const Vec3 centre = vector(properties.CentreOfMass().XYZ());
      for (const Name& name : names_)
        if (is(surface, centre, name) && faces.find(name.name) == faces.end()) faces[name.name] = face;
    }
  }

  [[nodiscard]] std::size_t names() const { return names_.size(); }

 private:
  static Vec3 centre_of(const Polygon& polygon) {
    Vec3 sum = Vec3::Zero();
    for (const Vec3& p : polygon) sum += p;
    return sum / static_cast<double>(polygon.size());
  }

  static bool is(const BRepAdaptor_Surface& surface, const Vec3& centre, const Name& name) {
    constexpr double kSame = 1e-6;
    if ((centre - name.p).norm() > name.reach_mm) return false;
    if (name.radius_mm == 0.0) {
      if (surface.GetType() != GeomAbs_Plane) return false;
      const Vec3 n = vector(surface.Plane().Axis().Direction().XYZ());
      return n.cross(name.n).norm() < kSame && std::abs(name.n.dot(centre - name.p)) < kSame;
    }
    if (surface.GetType() != GeomAbs_Cylinder) return false;
    const gp_Cylinder cylinder = surface.Cylinder();
    const Vec3 axis = vector(cylinder.Axis().Direction().XYZ());
    const Vec3 off = vector(cylinder.Location().XYZ()) - name.p;
    return std::abs(cylinder.Radius() - name.radius_mm) < kSame && axis.cross(name.n).norm() < kSame &&
           name.n.cross(off).norm() < kSame;
  }

  void add(const OrderedBlock& block, const Polygon& in_block, const std::string& name = "") {
    Polygon polygon;
    for (const Vec3& p : in_block) polygon.push_back(block.pose * p);
    const Vec3 n = normal_of(polygon);
    sewing_.Add(face_of(polygon, n));
    if (!name.empty()) names_.push_back({name + block.suffix, centre_of(polygon), n, 0.0, 60.0});
  }

  /// Adds all faces of a block but its foot, which is returned: counterclockwise from above.
  Polygon add_block(const OrderedBlock& block, const Profile& profile) {
    static constexpr std::array<const char*, Profile::kCorners - 1> kNames = {"",          "", "jaw_inner", "seat",
                                                                              "jaw_outer", "", ""};
    Polygon minus;
    Polygon plus;
    for (std::size_t i = 0; i < Profile::kCorners; ++i) {
      minus.push_back(profile.at(i, -1.0));
      plus.push_back(profile.at(i, 1.0));
    }
    add(block, minus);
    add(block, Polygon(plus.rbegin(), plus.rend()));
    for (std::size_t i = 0; i + 1 < Profile::kCorners; ++i)
      add(block, {minus[i], plus[i], plus[i + 1], minus[i + 1]}, kNames[i]);
    add_casings(block, profile);
    Polygon foot;
    for (const Vec3& p : {minus.front(), plus.front(), plus.back(), minus.back()}) foot.push_back(block.pose * p);
    return foot;
  }

  void add_casings(const OrderedBlock& block, const Profile& profile) {
    const BlockGeometry& g = block.geometry;
    const Vec3 n = block.pose.rotation * profile.normal();
    const Vec3 x = block.pose.rotation * Vec3::UnitX();
    const double bore = 0.5 * g.casing_bore_diameter_mm.value;
    const double rim = 0.5 * g.casing_rim_diameter_mm.value;
    const double height = g.casing_rim_height_mm.value;
    const double floor = kBoreShown * profile.corners().front().z;
    constexpr double kAbove = 20.0;  // the tool ends above every rim
    for (const double sign : {-1.0, 1.0}) {
      const Vec3 centre = block.pose * (sign * g.casing_half_spacing_mm.value * profile.along());
      const auto cylinder = [&](double radius, double from, double to) {
        const Vec3 base = centre + from * n;
        return BRepPrimAPI_MakeCylinder(gp_Ax2(point(base), direction(n), direction(x)), radius, to - from).Shape();
      };
      if (height < 0.0) cuts_.Append(cylinder(rim, height, kAbove));
      if (height > 0.0) rings_.Append(cylinder(rim, 0.5 * floor, height));
      cuts_.Append(cylinder(bore, floor, kAbove));
      names_.push_back({(sign < 0.0 ? "casing_inner" : "casing_outer") + block.suffix, centre, n, bore, 200.0});
    }
  }

  Status add_body(const std::vector<Polygon>& feet) {
    const double x = 0.5 * order_.length_mm;
    const double y = 0.5 * order_.width_mm;
    const double z = -order_.thickness_mm;
    for (const Polygon& foot : feet)
      for (const Vec3& p : foot)
        if (std::abs(p.z()) > 1e-6 || std::abs(p.x()) >= x || std::abs(p.y()) >= y)
          return error(Code::config, "a block does not stand on the slab's top");
    const Polygon top = {{-x, -y, 0.0}, {x, -y, 0.0}, {x, y, 0.0}, {-x, y, 0.0}};
    const Polygon bottom = {{-x, -y, z}, {-x, y, z}, {x, y, z}, {x, -y, z}};
    sewing_.Add(face_of(top, Vec3::UnitZ(), feet));
    sewing_.Add(face_of(bottom, -Vec3::UnitZ()));
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec3& a = top[i];
      const Vec3& b = top[(i + 1) % 4];
      const Polygon side = {a, {a.x(), a.y(), z}, {b.x(), b.y(), z}, b};
      sewing_.Add(face_of(side, normal_of(side)));
    }
    names_.push_back({"slab_top", Vec3::Zero(), Vec3::UnitZ(), 0.0, 1e5});
    return success();
  }

  Status cut_casings(TopoDS_Shape& solid) {
    if (!rings_.IsEmpty()) {
      BRepAlgoAPI_Fuse fuse;
      TopTools_ListOfShape body;
      body.Append(solid);
      fuse.SetArguments(body);
      fuse.SetTools(rings_);
      fuse.Build();
      if (!fuse.IsDone()) return error(Code::config, "the rims of the casings cannot be joined");
      solid = fuse.Shape();
    }
    BRepAlgoAPI_Cut cut;
    TopTools_ListOfShape body;
    body.Append(solid);
    cut.SetArguments(body);
    cut.SetTools(cuts_);
    cut.Build();
    if (!cut.IsDone()) return error(Code::config, "the casings cannot be cut");
    TopExp_Explorer solids(cut.Shape(), TopAbs_SOLID);
    if (!solids.More()) return error(Code::config, "the casings leave no solid");
    solid = solids.Current();
    solids.Next();
    if (solids.More() || !BRepCheck_Analyzer(solid).IsValid())
      return error(Code::config, "the casings do not leave one valid solid");
    return success();
  }

  const ModelOrder& order_;
  BRepBuilderAPI_Sewing sewing_{1e-6};
  TopTools_ListOfShape cuts_;
  TopTools_ListOfShape rings_;
  std::vector<Name> names_;
};

}  // namespace

Status build_solid(const ModelOrder& order, TopoDS_Shape& solid, std::map<std::string, TopoDS_Shape>& faces) {
  Builder builder(order);
  if (Status built = builder.build(solid); !built) return built;
  builder.find_names(solid, faces);
  if (faces.size() != builder.names())
    return error(Code::internal, "%zu of %zu named faces are in the solid", faces.size(), builder.names());
  return success();
}

}  // namespace slabd::cad
