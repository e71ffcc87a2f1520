// SPDX-License-Identifier: Apache-2.0
#include "cli/recipe/recipe_source.h"

#include <fmt/core.h>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/render.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

constexpr std::string_view kSlab = "slab:";
constexpr std::string_view kSha = "sha:";

std::string path_of(const storage::RecipeText& text) {
  return fmt::format("sha:{}", text.sha256.view());
}

}  // namespace

bool names_stored_recipe(std::string_view word) {
  return word.starts_with(kSlab) || word.starts_with(kSha);
}

storage::RecipeText stored_recipe(storage::Reader& reader, const std::string& word) {
  std::string sha256 = word.starts_with(kSha) ? word.substr(kSha.size()) : "";
  std::string of_slab;
  if (word.starts_with(kSlab)) {
    const storage::SlabRecord slab = named_slab(reader, word.substr(kSlab.size()));
    const SlabHeader& header = slab.summary.header;
    sha256 = header.recipe_sha256.view();
    of_slab =
        fmt::format("; slab {} was begun with {} by {}", header.key, header.recipe.view(), header.software.view());
  }
  auto text = need(reader.recipe_text(sha256), kNotReachable);
  if (!text)
    stop(kBadInput,
         fmt::format("the database has kept no recipe with the SHA-256 '{}', or more than one that begins so{}", sha256,
                     of_slab));
  return std::move(*text);
}

bool recipe_from(const storage::RecipeText& text, Recipe& recipe) {
  std::vector<config::Problem> problems;
  config::parse_recipe(path_of(text), text.text, recipe, problems);
  if (problems.empty() && !(recipe.sha256 == text.sha256))
    problems.push_back({fmt::format("{}: the text that the database holds has the SHA-256 {}: it was changed",
                                    path_of(text), recipe.sha256.view())});
  return report_problems(problems);
}

Recipe recipe_named(storage::Reader* reader, const std::string& word) {
  if (!names_stored_recipe(word)) return recipe_from(word);
  Recipe recipe;
  if (!recipe_from(stored_recipe(*reader, word), recipe)) stop(kBadInput);
  return recipe;
}

RecipeStore::RecipeStore(std::vector<Recipe> of_folder) : of_folder_(std::move(of_folder)) {}

Result<const Recipe*> RecipeStore::very(const SlabHeader& slab, storage::Reader& reader) {
  for (const Recipe& recipe : of_folder_)
    if (recipe.sha256 == slab.recipe_sha256) return &recipe;
  for (const Recipe& recipe : of_database_)
    if (recipe.sha256 == slab.recipe_sha256) return &recipe;
  const Recipe* const nowhere = nullptr;
  const auto text = reader.recipe_text(slab.recipe_sha256.view());
  if (!text) return text.error();
  if (!text.value() || !(text.value()->sha256 == slab.recipe_sha256)) return nowhere;
  Recipe recipe;
  if (!recipe_from(*text.value(), recipe)) return nowhere;
  of_database_.push_back(recipe);
  const Recipe* const kept = &of_database_.back();
  return kept;
}

const Recipe* RecipeStore::of_type(const SlabHeader& slab) const {
  for (const Recipe& recipe : of_folder_)
    if (recipe.slab_type == slab.slab_type && recipe.stations() == slab.stations) return &recipe;
  return nullptr;
}

Recipe recipe_of_type(const config::Config& config, std::uint16_t slab_type) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;
  config::load_recipes(config.recipes_dir, recipes, problems);
  const Recipe* found = nullptr;
  for (const Recipe& candidate : recipes) {
    const bool longer = found == nullptr || candidate.slab.length_mm.value > found->slab.length_mm.value;
    if (slab_type == 0 ? longer : candidate.slab_type == slab_type) found = &candidate;
  }
  if (found != nullptr) return *found;
  std::ignore = report_problems(problems);
  stop(kBadInput, slab_type == 0 ? ""
                                 : fmt::format("--slab-type {}: {} has no usable recipe for this slab type", slab_type,
                                               config.recipes_dir));
}

}  // namespace slabd::cli
