// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe from-cad: the draft of a recipe from a CAD model. slabd-cad finds the faces; this writes the draft,
// the list and the picture.
#include <fmt/core.h>

#include <cmath>
#include <filesystem>
#include <memory>

#include "base/durable.h"
#include "base/plain_text.h"
#include "calib/calib.h"
#include "cli/cad/cad_commands.h"
#include "cli/cad/cad_findings.h"
#include "cli/cad/cad_picture.h"
#include "cli/cad/cad_process.h"
#include "cli/cad/draft.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string file;
  std::string out;
  std::string picture;
  std::string name;
  double reference_mm = 10.0;
  bool json = false;
};

/// STEP by its first line, IGES by the S in column 73; the extension may be wrong.
bool is_iges(const std::string& path, const std::string& bytes) {
  if (bytes.find("ISO-10303-21") < 1'000) return false;
  if (bytes.size() > 80 && bytes[72] == 'S') return true;
  stop(kBadInput, fmt::format("{}: it begins neither like a STEP nor like an IGES file", path));
}

std::string source_of(const std::string& file, const std::string& sha256, const CadValue& value) {
  return fmt::format("{}, sha256 {}{}", file, sha256, faces_text(value.faces));
}

int from_cad(Options options) {
  check_draft_path(options.out, {options.file});
  const std::string program = need(cad_program());
  const std::string bytes = need(read_bounded(options.file, kCadInputBytesMax), kBadInput);
  const std::string sha256 = calib::sha256_hex(bytes);
  const std::string shown = plain(std::filesystem::path(options.file).filename().string());
  const bool iges = is_iges(options.file, bytes);
  const CadAnswer answer = need(run_cad(
      program, {"import", iges ? "iges" : "step", fmt::format("{}", options.reference_mm)}, bytes, options.file));
  const CadFindings findings = need(parse_findings(answer.output));
  if (findings.blocks == 0)
    stop(kBadInput, fmt::format("{}: no supporting block was found: {}", options.file,
                                findings.not_found.empty() ? "" : findings.not_found.front().why));
  if (options.name.empty()) options.name = first_bytes(plain(std::filesystem::path(options.file).stem().string()), 32);
  std::error_code none;
  if (!options.picture.empty() && std::filesystem::equivalent(options.picture, options.file, none))
    stop(kUsage, fmt::format("--picture {} is the file that is read", options.picture));
  if (options.picture.empty()) options.picture = std::filesystem::path(options.out).replace_extension(".png").string();

  std::vector<std::string> head = {
      fmt::format("Draft of a recipe from {}.", shown),
      fmt::format("SHA-256 of the file: {}", sha256),
      "",
      "Every number is unconfirmed: compare each with the drawing, then set its confirmed = true. `source` names the",
      fmt::format("file and its faces, in the order of the file; {} shows them in colours.",
                  plain(std::filesystem::path(options.picture).filename().string())),
      fmt::format("The distance of the jaws is stated {} mm above the seat (--reference-height).",
                  options.reference_mm),
  };
  if (!findings.not_found.empty()) head.insert(head.end(), {"", "Not found:"});
  for (const CadMissing& missing : findings.not_found)
    head.push_back(fmt::format("  {}: {}", missing.key, missing.why));
  if (!findings.remarks.empty()) head.insert(head.end(), {"", "Look at:"});
  for (const std::string& remark : findings.remarks) head.push_back("  " + remark);
  const auto number = [&](std::string_view key) -> std::optional<DraftNumber> {
    if (key == "block.jaw_reference_height_mm")
      return DraftNumber{options.reference_mm, "chosen: --reference-height, in no CAD model"};
    const CadValue* const value = findings.value(key);
    if (value == nullptr) return std::nullopt;
    if (value->faces.empty()) return DraftNumber{value->value, value->note};
    return DraftNumber{value->value, source_of(shown, sha256, *value)};
  };
  const auto reason = [&](std::string_view key) -> std::string {
    for (const CadMissing& missing : findings.not_found)
      if (missing.key == key || missing.key == key.substr(0, key.find('.'))) return missing.why;
    return "the model does not show it";
  };
  OutFile out(options.out);
  out.write(draft_text(head, options.name, number, reason));
  need(out.close(), kBadInput);
  const std::string title = fmt::format("{}  sha256 {:.12}  blocks found: {}", shown, sha256, findings.blocks);
  need(write_cad_picture(options.picture, findings, title), kBadInput);
  const CadDraft draft{options.file, sha256, options.out, options.picture, options.reference_mm, findings};
  OutFile document(std::filesystem::path(options.out).replace_extension(".json").string());
  document.write(json_of(draft));
  need(document.close(), kBadInput);
  fmt::print("{}", options.json ? json_of(draft) : text_of(draft));
  if (!options.json)
    fmt::print("\n{} is a draft: look at {}, confirm each number with the drawing, and add what is missing\n",
               options.out, options.picture);
  return kDone;
}

}  // namespace

void add_recipe_from_cad(args::Command& recipe) {
  auto options = std::make_shared<Options>();
  args::Command command = recipe.add_subcommand("from-cad", "The draft of a recipe from a STEP or IGES model");
  command->footer(
      "\nFinds the slab's top, seats, jaws, casings and the rest by geometry; names in the file, units, placements "
      "and\n"
      "the frame do not matter. Nothing is guessed: what was not found, or is contradictory, is listed and left out.\n"
      "Beside the draft it writes the list (.json) and the picture (.png); in [recipes] dir/drafts the page shows "
      "them.\n"
      "A model of triangles (STL, or STEP with facets) is refused. Needs the package slabd-cad. See docs/CAD.md.\n"
      "Example: slabctl recipe from-cad slab.stp --out draft.toml");
  command->add_option("FILE", options->file, "STEP or IGES file")->required();
  command->add_option("--out", options->out, "The draft, .toml")->required();
  command->add_option("--picture", options->picture,
                      "The model with the found faces in colours, .png; default: the draft's name with .png");
  command->add_option("--name", options->name, "Name of the recipe; default: the file's name");
  command
      ->add_option("--reference-height", options->reference_mm,
                   "Height above the seat at which the distance of the jaws is stated, mm")
      ->check(within(1.0, 30.0))
      .capture_default_str();
  command->add_flag("--json", options->json, "Print slabd.cad_draft/1 on stdout");
  command->runs([options] { return from_cad(*options); });
}

}  // namespace slabd::cli
