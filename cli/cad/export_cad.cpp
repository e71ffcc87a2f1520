// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "base/durable.h"
#include "cli/cad/cad_commands.h"
#include "cli/cad/cad_process.h"
#include "cli/exit.h"

namespace slabd::cli {
namespace {

std::string extension_of(const std::string& path) {
  std::string extension = std::filesystem::path(path).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

bool is_iges(const std::string& path) {
  const std::string extension = extension_of(path);
  return extension == ".igs" || extension == ".iges";
}

}  // namespace

bool is_cad_file(const std::string& path) {
  const std::string extension = extension_of(path);
  return extension == ".stp" || extension == ".step" || is_iges(path);
}

void export_cad(const Recipe& recipe, const SlabDesign& design, const ModelChoice& choice, bool ap214,
                const std::string& path) {
  const bool iges = is_iges(path);
  if (choice.pmi && iges) stop(kUsage, "--pmi: IGES has no tolerances; write .step");
  if (choice.pmi && ap214) stop(kUsage, "--pmi: AP214 has no tolerances that a program can read; leave --ap214 out");
  if (iges && ap214) stop(kUsage, "--ap214: an IGES file has no application protocol");
  const std::string name = fmt::format("{} {}", recipe.name.view(), choice.block ? "block" : "slab");
  const std::string order = model_order(recipe, design, choice, name);
  const std::string program = need(cad_program());
  const CadAnswer answer = need(run_cad(program,
                                        {"export", iges    ? "iges"
                                                   : ap214 ? "ap214"
                                                           : "step"},
                                        order, std::string(recipe.path.view())));
  OutFile out(path);
  out.write(answer.output);
  need(out.close(), kBadInput);
  const std::size_t blank = answer.note.find(' ');
  fmt::print("{}: {} faces, {} mm3\n", path, answer.note.substr(0, blank),
             blank == std::string::npos ? "?" : answer.note.substr(blank + 1));
}

}  // namespace slabd::cli
