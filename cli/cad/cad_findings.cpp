// SPDX-License-Identifier: Apache-2.0
#include "cli/cad/cad_findings.h"

#include <fmt/core.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/plain_text.h"
#include "cli/cad/draft.h"
#include "report/json.h"
#include "report/table.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// One line of printable text: it is printed, and written into a file.
std::string text_at(const json& object, const char* key) {
  return first_bytes(plain(object.at(key).get<std::string>()), 300);
}

double finite(double value) {
  if (!std::isfinite(value) || std::abs(value) > 1e9) throw std::range_error("a number is out of range");
  return value;
}

CadPart part_of(const json& object) {
  CadPart part;
  part.face = object.at("face").get<int>();
  const auto numbers = object.at("triangles").get<std::vector<double>>();
  for (std::size_t i = 0; i + 9 <= numbers.size(); i += 9) {
    std::array<Vec3, 3> triangle;
    for (std::size_t k = 0; k < 9; ++k) triangle[k / 3][static_cast<Eigen::Index>(k % 3)] = finite(numbers[i + k]);
    part.triangles.push_back(triangle);
  }
  return part;
}

/// The common fields of both documents. `names`: key of the faces with a meaning.
void read_findings(const json& document, const char* names, CadFindings& findings) {
  findings.unit = text_at(document, "unit");
  findings.solids = document.at("solids").get<int>();
  findings.faces = document.at("faces").get<int>();
  findings.blocks = document.at("blocks").get<int>();
  findings.confined = document.at("confined").get<bool>();
  for (const json& value : document.at("found"))
    findings.found.push_back({text_at(value, "key"), finite(value.at("value").get<double>()),
                              value.at("faces").get<std::vector<int>>(), text_at(value, "note")});
  for (const json& value : document.at("not_found"))
    findings.not_found.push_back({text_at(value, "key"), text_at(value, "why")});
  for (const json& remark : document.at("remarks")) findings.remarks.push_back(plain(remark.get<std::string>()));
  for (const json& named : document.at(names))
    findings.names.push_back({text_at(named, "name"), named.at("face").get<int>()});
}

json parsed(const std::string& text, const char* schema) {
  json document = json::parse(text);
  if (document.at("schema") != schema) throw std::range_error("its schema is another one");
  return document;
}

}  // namespace

const CadValue* CadFindings::value(std::string_view key) const {
  for (const CadValue& value : found)
    if (value.key == key) return &value;
  return nullptr;
}

Result<CadFindings> parse_findings(const std::string& text) {
  CadFindings findings;
  try {
    const json document = parsed(text, "slabd.cad_findings/1");
    read_findings(document, "names", findings);
    for (const json& part : document.at("picture")) findings.parts.push_back(part_of(part));
  } catch (const std::exception& fault) {
    return error(Code::config, "slabd-cad gave an answer that this slabctl cannot read: %.200s", fault.what());
  }
  return findings;
}

Result<CadDraft> parse_draft(const std::string& text) {
  CadDraft draft;
  try {
    const json document = parsed(text, "slabd.cad_draft/1");
    draft.file = text_at(document, "file");
    draft.sha256 = text_at(document, "sha256");
    draft.draft = text_at(document, "draft");
    draft.picture = text_at(document, "picture");
    draft.reference_height_mm = finite(document.at("reference_height_mm").get<double>());
    read_findings(document, "named_faces", draft.findings);
  } catch (const std::exception& fault) {
    return error(Code::config, "expected is a slabd.cad_draft/1: %.200s", fault.what());
  }
  return draft;
}

std::string json_of(const CadDraft& draft) {
  const CadFindings& findings = draft.findings;
  report::Json json("slabd.cad_draft/1");
  json.field("file", draft.file).field("sha256", draft.sha256).field("unit", findings.unit);
  json.field("solids", findings.solids).field("faces", findings.faces).field("blocks", findings.blocks);
  json.field("reference_height_mm", draft.reference_height_mm).field("confined", findings.confined);
  json.field("draft", draft.draft).field("picture", draft.picture);
  json.list("found", findings.found, [&](const CadValue& value) {
    json.field("key", value.key).field("value", value.value).field("faces", value.faces).field("note", value.note);
  });
  json.list("not_found", findings.not_found,
            [&](const CadMissing& missing) { json.field("key", missing.key).field("why", missing.why); });
  json.field("remarks", findings.remarks);
  json.list("named_faces", findings.names,
            [&](const CadName& named) { json.field("name", named.name).field("face", named.face); });
  return json.text();
}

std::string text_of(const CadDraft& draft) {
  const CadFindings& findings = draft.findings;
  std::string text = fmt::format("{}: {} faces, {} solids, unit {}; {} blocks found\n\n", draft.file, findings.faces,
                                 findings.solids, findings.unit.empty() ? "not named" : findings.unit, findings.blocks);
  report::Table table{"key", "value", "from<"};
  for (const CadValue& value : findings.found)
    table.add(value.key, report::Cell(value.value, 6), value.note + faces_text(value.faces));
  text += report::text_of(table);
  if (!findings.not_found.empty()) text += "\nnot found:\n";
  for (const CadMissing& missing : findings.not_found) text += fmt::format("  {}: {}\n", missing.key, missing.why);
  if (!findings.remarks.empty()) text += "\nlook at:\n";
  for (const std::string& remark : findings.remarks) text += fmt::format("  {}\n", remark);
  return text;
}

std::string faces_text(const std::vector<int>& faces) {
  if (faces.empty()) return "";
  std::string text = faces.size() == 1 ? ", face" : ", faces";
  constexpr std::size_t kShown = 4;
  for (std::size_t i = 0; i < faces.size() && i < kShown; ++i)
    text += fmt::format("{} {}", i == 0 ? "" : ",", faces[i]);
  if (faces.size() > kShown) text += " ...";
  return text;
}

}  // namespace slabd::cli
