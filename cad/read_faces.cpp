// SPDX-License-Identifier: Apache-2.0
#include "cad/read_faces.h"

#include <BRepAdaptor_Curve.hxx>
#include <BRepAdaptor_Surface.hxx>
#include <BRepBuilderAPI_MakeSolid.hxx>
#include <BRepBuilderAPI_Sewing.hxx>
#include <BRepGProp.hxx>
#include <BRepLib.hxx>
#include <BRepMesh_IncrementalMesh.hxx>
#include <BRep_Builder.hxx>
#include <BRep_Tool.hxx>
#include <GProp_GProps.hxx>
#include <IGESControl_Reader.hxx>
#include <IGESData_GlobalSection.hxx>
#include <IGESData_IGESModel.hxx>
#include <Interface_Static.hxx>
#include <Poly_Triangulation.hxx>
#include <STEPControl_Reader.hxx>
#include <ShapeUpgrade_UnifySameDomain.hxx>
#include <TColStd_SequenceOfAsciiString.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS.hxx>
#include <TopoDS_Compound.hxx>
#include <TopoDS_Edge.hxx>
#include <TopoDS_Face.hxx>
#include <TopoDS_Solid.hxx>
#include <gp_Circ.hxx>
#include <gp_Cylinder.hxx>
#include <gp_Pln.hxx>

#include <cmath>

namespace slabd::cad {
namespace {

/// More faces than any slab has; a file with more is a building or a bomb.
constexpr int kFacesMax = 20'000;
constexpr std::size_t kTrianglesMax = 300'000;
constexpr double kFlat_mm = 1e-6;

Vec3 vector(const gp_XYZ& v) {
  return {v.X(), v.Y(), v.Z()};
}

Result<TopoDS_Shape> shape_of(const std::string& path, bool iges, std::string& unit) {
  Interface_Static::SetCVal("xstep.cascade.unit", "MM");
  TopoDS_Shape shape;
  if (iges) {
    IGESControl_Reader reader;
    if (reader.ReadFile(path.c_str()) != IFSelect_RetDone) return error(Code::config, "it is not an IGES file");
    const Handle(IGESData_IGESModel) model = Handle(IGESData_IGESModel)::DownCast(reader.Model());
    if (!model.IsNull() && !model->GlobalSection().UnitName().IsNull())
      unit = model->GlobalSection().UnitName()->ToCString();
    reader.TransferRoots();
    shape = reader.OneShape();
  } else {
    STEPControl_Reader reader;
    if (reader.ReadFile(path.c_str()) != IFSelect_RetDone) return error(Code::config, "it is not a STEP file");
    TColStd_SequenceOfAsciiString lengths;
    TColStd_SequenceOfAsciiString angles;
    TColStd_SequenceOfAsciiString solid_angles;
    reader.FileUnits(lengths, angles, solid_angles);
    for (const TCollection_AsciiString& word : lengths)
      if (unit.find(word.ToCString()) == std::string::npos)
        unit += (unit.empty() ? "" : ", ") + std::string(word.ToCString());
    reader.TransferRoots();
    shape = reader.OneShape();
  }
  if (shape.IsNull()) return error(Code::config, "it has no shape");
  return shape;
}

int count(const TopoDS_Shape& shape, TopAbs_ShapeEnum kind, TopAbs_ShapeEnum but = TopAbs_SHAPE) {
  int number = 0;
  for (TopExp_Explorer at(shape, kind, but); at.More() && number <= kFacesMax; at.Next()) ++number;
  return number;
}

/// Joins loose faces to solids where they close; a file of solids stays as it is.
TopoDS_Shape closed(const TopoDS_Shape& shape) {
  if (count(shape, TopAbs_FACE, TopAbs_SOLID) == 0) return shape;
  BRepBuilderAPI_Sewing sewing(1e-3);
  sewing.Add(shape);
  sewing.Perform();
  BRep_Builder builder;
  TopoDS_Compound all;
  builder.MakeCompound(all);
  for (TopExp_Explorer at(sewing.SewedShape(), TopAbs_SHELL); at.More(); at.Next()) {
    const TopoDS_Shell shell = TopoDS::Shell(at.Current());
    if (!BRep_Tool::IsClosed(shell)) {
      builder.Add(all, shell);
      continue;
    }
    TopoDS_Solid solid = BRepBuilderAPI_MakeSolid(shell).Solid();
    BRepLib::OrientClosedSolid(solid);
    builder.Add(all, solid);
  }
  for (TopExp_Explorer at(sewing.SewedShape(), TopAbs_FACE, TopAbs_SHELL); at.More(); at.Next())
    builder.Add(all, at.Current());
  return all;
}

/// Joins pieces of one plane or cylinder that touch.
TopoDS_Shape joined(const TopoDS_Shape& shape) {
  ShapeUpgrade_UnifySameDomain unify(shape, Standard_True, Standard_True, Standard_False);
  unify.SetLinearTolerance(1e-6);
  unify.SetAngularTolerance(1e-9);
  unify.Build();
  return unify.Shape().IsNull() ? shape : unify.Shape();
}

void read_plane(const TopoDS_Face& face, const gp_Pln& plane, ModelFace& out) {
  out.kind = FaceKind::plane;
  out.p = vector(plane.Location().XYZ());
  out.n = vector(plane.Axis().Direction().XYZ());
  if (!plane.Direct()) out.n = -out.n;  // a mirrored plane: the normal of its parameters is the other one
  if (face.Orientation() == TopAbs_REVERSED) out.n = -out.n;
}

void read_cylinder(const TopoDS_Face& face, const gp_Cylinder& cylinder, ModelFace& out) {
  out.kind = FaceKind::cylinder;
  out.p = vector(cylinder.Location().XYZ());
  out.n = vector(cylinder.Axis().Direction().XYZ());
  out.radius_mm = cylinder.Radius();
  out.hollow = (face.Orientation() == TopAbs_REVERSED) == cylinder.Direct();
}

/// A surface of another type that is a cylinder: all its points are at one distance from the axis of its circle.
bool is_cylinder(const TopoDS_Face& face, const BRepAdaptor_Surface& surface, ModelFace& out) {
  for (TopExp_Explorer at(face, TopAbs_EDGE); at.More(); at.Next()) {
    const TopoDS_Edge edge = TopoDS::Edge(at.Current());
    if (BRep_Tool::Degenerated(edge)) continue;
    const BRepAdaptor_Curve curve(edge);
    if (curve.GetType() != GeomAbs_Circle) continue;
    const gp_Circ circle = curve.Circle();
    const Vec3 axis = vector(circle.Axis().Direction().XYZ());
    const Vec3 centre = vector(circle.Location().XYZ());
    constexpr int kSteps = 8;
    const double u0 = surface.FirstUParameter();
    const double v0 = surface.FirstVParameter();
    const double du = (surface.LastUParameter() - u0) / kSteps;
    const double dv = (surface.LastVParameter() - v0) / kSteps;
    if (!std::isfinite(du) || !std::isfinite(dv) || std::abs(du) > 1e6 || std::abs(dv) > 1e6) return false;
    bool same = true;
    for (int i = 0; i <= kSteps && same; ++i)
      for (int j = 0; j <= kSteps && same; ++j) {
        const Vec3 off = vector(surface.Value(u0 + i * du, v0 + j * dv).XYZ()) - centre;
        same = std::abs((off - axis.dot(off) * axis).norm() - circle.Radius()) < kFlat_mm;
      }
    if (!same) continue;
    gp_Pnt p;
    gp_Vec along_u;
    gp_Vec along_v;
    surface.D1(u0 + 0.4 * kSteps * du, v0 + 0.4 * kSteps * dv, p, along_u, along_v);
    Vec3 normal = vector(along_u.Crossed(along_v).XYZ());
    if (face.Orientation() == TopAbs_REVERSED) normal = -normal;
    const Vec3 off = vector(p.XYZ()) - centre;
    out.kind = FaceKind::cylinder;
    out.p = centre;
    out.n = axis;
    out.radius_mm = circle.Radius();
    out.hollow = normal.dot(off - axis.dot(off) * axis) < 0.0;
    return true;
  }
  return false;
}

/// A surface of another type that is a plane: a grid of its points is on the plane of its middle.
bool is_plane(const TopoDS_Face& face, const BRepAdaptor_Surface& surface, ModelFace& out) {
  constexpr int kSteps = 6;
  const double u0 = surface.FirstUParameter();
  const double v0 = surface.FirstVParameter();
  const double du = (surface.LastUParameter() - u0) / kSteps;
  const double dv = (surface.LastVParameter() - v0) / kSteps;
  if (!std::isfinite(du) || !std::isfinite(dv) || std::abs(du) > 1e6 || std::abs(dv) > 1e6) return false;
  gp_Pnt p;
  gp_Vec along_u;
  gp_Vec along_v;
  surface.D1(u0 + 0.5 * kSteps * du, v0 + 0.5 * kSteps * dv, p, along_u, along_v);
  Vec3 n = vector(along_u.Crossed(along_v).XYZ());
  if (!(n.norm() > 1e-12)) return false;
  n.normalize();
  const Vec3 middle = vector(p.XYZ());
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; j <= kSteps; ++j)
      if (std::abs(n.dot(vector(surface.Value(u0 + i * du, v0 + j * dv).XYZ()) - middle)) > kFlat_mm) return false;
  out.kind = FaceKind::plane;
  out.p = middle;
  out.n = face.Orientation() == TopAbs_REVERSED ? Vec3(-n) : n;
  return true;
}

void read_boundary(const TopoDS_Face& face, ModelFace& out) {
  for (TopExp_Explorer at(face, TopAbs_EDGE); at.More(); at.Next()) {
    const TopoDS_Edge edge = TopoDS::Edge(at.Current());
    if (BRep_Tool::Degenerated(edge)) continue;
    const BRepAdaptor_Curve curve(edge);
    const double first = curve.FirstParameter();
    const double last = curve.LastParameter();
    if (!std::isfinite(first) || !std::isfinite(last) || std::abs(first) > 1e9 || std::abs(last) > 1e9) continue;
    for (const double parameter : {first, 0.5 * (first + last), last})
      out.corners.push_back(vector(curve.Value(parameter).XYZ()));
    if (curve.GetType() == GeomAbs_Circle)
      out.circles.push_back({vector(curve.Circle().Location().XYZ()), curve.Circle().Radius()});
  }
}

void read_triangles(const TopoDS_Face& face, std::size_t& left, ModelFace& out) {
  TopLoc_Location place;
  const Handle(Poly_Triangulation) mesh = BRep_Tool::Triangulation(face, place);
  if (mesh.IsNull()) return;
  const gp_Trsf move = place.Transformation();
  for (int i = 1; i <= mesh->NbTriangles() && left > 0; ++i, --left) {
    std::array<int, 3> corner{};
    mesh->Triangle(i).Get(corner[0], corner[1], corner[2]);
    std::array<Vec3, 3> triangle;
    for (std::size_t k = 0; k < 3; ++k) triangle[k] = vector(mesh->Node(corner[k]).Transformed(move).XYZ());
    out.triangles.push_back(triangle);
  }
}

ModelFace read_face(const TopoDS_Face& face, int number, std::size_t& triangles_left) {
  ModelFace out;
  out.number = number;
  const BRepAdaptor_Surface surface(face);
  GProp_GProps properties;
  BRepGProp::SurfaceProperties(face, properties);
  out.area_mm2 = std::abs(properties.Mass());
  out.centre = vector(properties.CentreOfMass().XYZ());
  if (surface.GetType() == GeomAbs_Plane) {
    read_plane(face, surface.Plane(), out);
  } else if (surface.GetType() == GeomAbs_Cylinder) {
    read_cylinder(face, surface.Cylinder(), out);
  } else if (!is_cylinder(face, surface, out)) {
    static_cast<void>(is_plane(face, surface, out));
  }
  read_boundary(face, out);
  read_triangles(face, triangles_left, out);
  return out;
}

bool is_finite(const ModelFace& face) {
  return face.p.allFinite() && face.n.allFinite() && face.centre.allFinite() && std::isfinite(face.area_mm2) &&
         std::isfinite(face.radius_mm) && face.centre.norm() < 1e7 && std::abs(face.n.norm() - 1.0) < 1e-6;
}

}  // namespace

Result<FaceList> read_faces(const std::string& path, bool iges) {
  FaceList list;
  const Result<TopoDS_Shape> read = shape_of(path, iges, list.unit);
  if (!read) return read.error();
  const int faces = count(read.value(), TopAbs_FACE);
  if (faces == 0) return error(Code::config, "it has no surfaces, as a model of triangles; export it as solids");
  if (faces > kFacesMax)
    return error(Code::config, "it has more than %d faces; export the slab or one block alone", kFacesMax);
  const TopoDS_Shape shape = joined(closed(read.value()));
  list.solids = count(shape, TopAbs_SOLID);
  list.has_sides = count(shape, TopAbs_FACE, TopAbs_SOLID) == 0;
  const BRepMesh_IncrementalMesh mesh(shape, 1.0, Standard_False, 0.3);
  std::size_t triangles_left = kTrianglesMax;
  int number = 0;
  for (TopExp_Explorer at(shape, TopAbs_FACE); at.More(); at.Next()) {
    ModelFace face = read_face(TopoDS::Face(at.Current()), ++number, triangles_left);
    if (is_finite(face)) list.faces.push_back(std::move(face));
  }
  return list;
}

}  // namespace slabd::cad
