// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"

/// The document slabd.cad_findings/1: what slabd-cad found in a file. It is checked like a file from outside, because
/// a damaged CAD file may have taken over the process that wrote it.
namespace slabd::cli {

struct CadValue {
  std::string key;  ///< of the recipe: "block.cant_ratio"
  double value = 0.0;
  std::vector<int> faces;
  std::string note;
};

struct CadMissing {
  std::string key;
  std::string why;
};

struct CadName {
  std::string name;  ///< "seat_3"
  int face = 0;
};

struct CadPart {
  int face = 0;
  std::vector<std::array<Vec3, 3>> triangles;  ///< mm, in the file's frame
};

struct CadFindings {
  std::string unit;
  int solids = 0;
  int faces = 0;
  int blocks = 0;
  bool confined = false;
  std::vector<CadValue> found;
  std::vector<CadMissing> not_found;
  std::vector<std::string> remarks;
  std::vector<CadName> names;
  std::vector<CadPart> parts;

  [[nodiscard]] const CadValue* value(std::string_view key) const;
};

/// config: it is not such a document.
[[nodiscard]] Result<CadFindings> parse_findings(const std::string& text);

/// The document slabd.cad_draft/1: what the draft of a recipe was made from. It is written beside the draft.
struct CadDraft {
  std::string file;
  std::string sha256;
  std::string draft;    ///< path
  std::string picture;  ///< path
  double reference_height_mm = 0.0;
  CadFindings findings;  ///< without parts
};

[[nodiscard]] std::string json_of(const CadDraft& draft);
[[nodiscard]] std::string text_of(const CadDraft& draft);
/// config: it is not such a document.
[[nodiscard]] Result<CadDraft> parse_draft(const std::string& text);

/// ", faces 3, 7, 12": the first four.
[[nodiscard]] std::string faces_text(const std::vector<int>& faces);

}  // namespace slabd::cli
