// SPDX-License-Identifier: Apache-2.0
#include "cad/write_model.h"

#include <APIHeaderSection_MakeHeader.hxx>
#include <BRepGProp.hxx>
#include <GProp_GProps.hxx>
#include <IGESCAFControl_Writer.hxx>
#include <IGESControl_Controller.hxx>
#include <IGESData_IGESModel.hxx>
#include <IGESData_IGESWriter.hxx>
#include <IGESData_Protocol.hxx>
#include <IGESSelect_WorkLibrary.hxx>
#include <Interface_FloatWriter.hxx>
#include <Interface_Static.hxx>
#include <STEPCAFControl_Controller.hxx>
#include <STEPCAFControl_Writer.hxx>
#include <StepBasic_MeasureValueMember.hxx>
#include <StepBasic_MeasureWithUnit.hxx>
#include <StepBasic_NamedUnit.hxx>
#include <StepBasic_SiUnitAndPlaneAngleUnit.hxx>
#include <StepBasic_Unit.hxx>
#include <StepData_Protocol.hxx>
#include <StepData_StepModel.hxx>
#include <StepData_StepWriter.hxx>
#include <TCollection_HAsciiString.hxx>
#include <TDataStd_Name.hxx>
#include <TDocStd_Document.hxx>
#include <TopExp_Explorer.hxx>
#include <TopoDS_Shape.hxx>
#include <XCAFApp_Application.hxx>
#include <XCAFDimTolObjects_DimensionObject.hxx>
#include <XCAFDimTolObjects_GeomToleranceObject.hxx>
#include <XCAFDoc_DimTolTool.hxx>
#include <XCAFDoc_Dimension.hxx>
#include <XCAFDoc_DocumentTool.hxx>
#include <XCAFDoc_GeomTolerance.hxx>
#include <XCAFDoc_ShapeTool.hxx>
#include <XSControl_WorkSession.hxx>

#include <map>
#include <ostream>

#include "cad/solid.h"

namespace slabd::cad {
namespace {

using Labels = std::map<std::string, TDF_Label>;

void name_label(const TDF_Label& label, const std::string& name) {
  TDataStd_Name::Set(label, TCollection_ExtendedString(name.c_str(), Standard_True));
}

/// Adds the tolerance to the faces' labels.
void add_pmi(const Handle(XCAFDoc_DimTolTool) & tool, const OrderedPmi& pmi, const Labels& labels) {
  const Handle(TCollection_HAsciiString) name = new TCollection_HAsciiString(pmi.name.c_str());
  if (pmi.kind == OrderedPmi::Kind::flatness) {
    const TDF_Label label = tool->AddGeomTolerance();
    Handle(XCAFDoc_GeomTolerance) tolerance;
    if (!label.FindAttribute(XCAFDoc_GeomTolerance::GetID(), tolerance)) return;
    const Handle(XCAFDimTolObjects_GeomToleranceObject) object = new XCAFDimTolObjects_GeomToleranceObject();
    object->SetSemanticName(name);
    object->SetType(XCAFDimTolObjects_GeomToleranceType_Flatness);
    object->SetTypeOfValue(XCAFDimTolObjects_GeomToleranceTypeValue_None);
    object->SetValue(pmi.upper);
    tolerance->SetObject(object);
    tool->SetGeomTolerance(labels.at(pmi.faces[0]), label);
    return;
  }
  const TDF_Label label = tool->AddDimension();
  Handle(XCAFDoc_Dimension) dimension;
  if (!label.FindAttribute(XCAFDoc_Dimension::GetID(), dimension)) return;
  const Handle(XCAFDimTolObjects_DimensionObject) object = new XCAFDimTolObjects_DimensionObject();
  object->SetSemanticName(name);
  object->SetType(pmi.kind == OrderedPmi::Kind::angle ? XCAFDimTolObjects_DimensionType_Location_Angular
                                                      : XCAFDimTolObjects_DimensionType_Location_LinearDistance);
  // The file's unit of angles is the radian.
  const double unit = pmi.kind == OrderedPmi::Kind::angle ? rad_from_deg(1.0) : 1.0;
  object->SetValue(unit * pmi.nominal);
  object->SetUpperTolValue(unit * (pmi.upper - pmi.nominal));
  object->SetLowerTolValue(unit * (pmi.nominal - pmi.lower));
  dimension->SetObject(object);
  tool->SetDimension(labels.at(pmi.faces[0]), labels.at(pmi.faces[1]), label);
}

/// 17 significant digits. Both formats require a decimal point, which %G would leave out.
void with_all_digits(Interface_FloatWriter& writer) {
  writer.SetFormat("%.16E");
  writer.SetFormatForRange("%.16E", 1.0, 1.0);
}

/// OpenCASCADE 7.6 writes the limits of a dimension as bare numbers; the schema requires the kind of measure.
void name_measures(const Handle(StepData_StepModel) & model) {
  for (int i = 1; i <= model->NbEntities(); ++i) {
    const Handle(StepBasic_MeasureWithUnit) measure = Handle(StepBasic_MeasureWithUnit)::DownCast(model->Value(i));
    if (measure.IsNull() || measure->ValueComponentMember().IsNull() || measure->ValueComponentMember()->HasName())
      continue;
    const Handle(StepBasic_NamedUnit) unit = measure->UnitComponent().NamedUnit();
    const bool is_angle = !unit.IsNull() && unit->IsKind(STANDARD_TYPE(StepBasic_SiUnitAndPlaneAngleUnit));
    measure->ValueComponentMember()->SetName(is_angle ? "PLANE_ANGLE_MEASURE" : "LENGTH_MEASURE");
  }
}

Status write_step(const ModelOrder& order, Form form, const Handle(TDocStd_Document) & document, std::ostream& out) {
  Interface_Static::SetCVal("write.step.schema", form == Form::step_ap242 ? "AP242DIS" : "AP214IS");
  Interface_Static::SetCVal("write.step.unit", "MM");
  Interface_Static::SetCVal("write.step.product.name", order.name.c_str());
  Interface_Static::SetIVal("write.stepcaf.subshapes.name", 1);
  Interface_Static::SetIVal("write.surfacecurve.mode", 1);
  STEPCAFControl_Writer writer;
  writer.SetColorMode(Standard_False);
  writer.SetLayerMode(Standard_False);
  writer.SetNameMode(Standard_True);
  writer.SetDimTolMode(form == Form::step_ap242);
  if (!writer.Transfer(document, STEPControl_AsIs)) return error(Code::internal, "the solid cannot be written as STEP");
  const Handle(StepData_StepModel) model = writer.ChangeWriter().Model();
  name_measures(model);
  APIHeaderSection_MakeHeader header(model);
  const auto text = [](const std::string& words) { return new TCollection_HAsciiString(words.c_str()); };
  header.SetName(text(order.name));
  header.SetAuthorValue(1, text("slabd"));
  header.SetOrganizationValue(1, text("slabd"));
  header.SetOriginatingSystem(text("slabd-cad"));
  header.SetDescriptionValue(1, text(order.description));
  StepData_StepWriter lines(model);
  with_all_digits(lines.FloatWriter());
  lines.SendModel(Handle(StepData_Protocol)::DownCast(writer.Writer().WS()->Protocol()));
  lines.Print(out);
  return success();
}

Status write_iges(const ModelOrder& order, const Handle(TDocStd_Document) & document, std::ostream& out) {
  Interface_Static::SetIVal("write.iges.brep.mode", 1);
  Interface_Static::SetCVal("write.iges.unit", "MM");
  Interface_Static::SetCVal("write.iges.header.product", order.name.c_str());
  Interface_Static::SetCVal("write.iges.header.author", "slabd");
  Interface_Static::SetCVal("write.iges.header.company", order.description.c_str());
  IGESCAFControl_Writer writer;
  writer.SetColorMode(Standard_False);
  writer.SetLayerMode(Standard_False);
  writer.SetNameMode(Standard_True);
  if (!writer.Transfer(document)) return error(Code::internal, "the solid cannot be written as IGES");
  writer.ComputeModel();
  IGESData_IGESWriter lines(writer.Model());
  with_all_digits(lines.FloatWriter());
  lines.SendModel(IGESSelect_WorkLibrary::DefineProtocol());
  if (!lines.Print(out)) return error(Code::internal, "the IGES file cannot be written");
  return success();
}

}  // namespace

Result<WrittenModel> write_model(const ModelOrder& order, Form form, std::ostream& out) {
  // Before the first parameter is set: the controllers define them.
  STEPCAFControl_Controller::Init();
  IGESControl_Controller::Init();
  TopoDS_Shape solid;
  std::map<std::string, TopoDS_Shape> faces;
  if (Status built = build_solid(order, solid, faces); !built) return built.error();

  Handle(TDocStd_Document) document;
  XCAFApp_Application::GetApplication()->NewDocument("MDTV-XCAF", document);
  const Handle(XCAFDoc_ShapeTool) shapes = XCAFDoc_DocumentTool::ShapeTool(document->Main());
  const TDF_Label part = shapes->AddShape(solid, Standard_False);
  name_label(part, order.name);
  Labels labels;
  for (const auto& [name, face] : faces) {
    const TDF_Label label = shapes->AddSubShape(part, face);
    if (label.IsNull()) return error(Code::internal, "face %s is not in the solid", name.c_str());
    name_label(label, name);
    labels[name] = label;
  }
  for (const OrderedPmi& pmi : order.pmi) {
    for (const std::string& face : pmi.faces)
      if (labels.find(face) == labels.end())
        return error(Code::config, "tolerance %s is of a face %s, which the model does not have", pmi.name.c_str(),
                     face.c_str());
    add_pmi(XCAFDoc_DocumentTool::DimTolTool(document->Main()), pmi, labels);
  }
  const Status written = form == Form::iges ? write_iges(order, document, out) : write_step(order, form, document, out);
  if (!written) return written.error();

  WrittenModel model;
  for (TopExp_Explorer at(solid, TopAbs_FACE); at.More(); at.Next()) ++model.faces;
  GProp_GProps properties;
  BRepGProp::VolumeProperties(solid, properties);
  model.volume_mm3 = properties.Mass();
  return model;
}

}  // namespace slabd::cad
