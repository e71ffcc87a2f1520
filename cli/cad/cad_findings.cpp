// SPDX-License-Identifier: Apache-2.0
#include "cli/cad/cad_findings.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/plain_text.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// One line of printable text: it is printed, and written into a file.
std::string text_at(const json& object, const char* key) {
  std::string text = plain(object.at(key).get<std::string>());
  if (text.size() > 300) text.resize(300);
  return text;
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

}  // namespace

const CadValue* CadFindings::value(std::string_view key) const {
  for (const CadValue& value : found)
    if (value.key == key) return &value;
  return nullptr;
}

Result<CadFindings> parse_findings(const std::string& text) {
  CadFindings findings;
  try {
    const json document = json::parse(text);
    if (document.at("schema") != "slabd.cad_findings/1") throw std::range_error("its schema is another one");
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
    for (const json& named : document.at("names"))
      findings.names.push_back({text_at(named, "name"), named.at("face").get<int>()});
    for (const json& part : document.at("picture")) findings.parts.push_back(part_of(part));
  } catch (const std::exception& fault) {
    return error(Code::config, "slabd-cad gave an answer that this slabctl cannot read: %.200s", fault.what());
  }
  return findings;
}

}  // namespace slabd::cli
