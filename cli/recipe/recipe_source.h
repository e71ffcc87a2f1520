// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <list>
#include <string>
#include <string_view>
#include <vector>

#include "base/recipe.h"
#include "config/config.h"
#include "storage/storage.h"

/// Recipes without a file: the database stores the recipes with which slabs were begun.
namespace slabd::cli {

/// True for "slab:SLAB" (the recipe with which this slab was begun) or "sha:PREFIX" instead of a file's path.
[[nodiscard]] bool names_stored_recipe(std::string_view word);
/// The stored recipe; stops if it does not exist.
[[nodiscard]] storage::RecipeText stored_recipe(storage::Reader& reader, const std::string& word);
/// Parses a stored text as the daemon does; its path is `sha:` and the whole SHA-256. Returns false with a message if
/// it is invalid for this slabd or does not match its SHA-256.
[[nodiscard]] bool recipe_from(const storage::RecipeText& text, Recipe& recipe);

/// The recipe of a file, or from `stored_recipe` in `reader` (not null for such a word). Stops if it is invalid.
[[nodiscard]] Recipe recipe_named(storage::Reader* reader, const std::string& word);

/// The recipes of a folder, and those of the database.
class RecipeStore {
 public:
  explicit RecipeStore(std::vector<Recipe> of_folder);

  /// The exact recipe with which the slab was begun, from the folder or else the database; nullptr if it is in
  /// neither. Valid as long as the recipe_store. Code::journal_write: the database cannot be read.
  [[nodiscard]] Result<const Recipe*> very(const SlabHeader& slab, storage::Reader& reader);
  /// The first recipe of the folder with the slab's type and size, or nullptr.
  [[nodiscard]] const Recipe* of_type(const SlabHeader& slab) const;

 private:
  std::vector<Recipe> of_folder_;
  std::list<Recipe> of_database_;
};

/// The recipe that the daemon will use for this slab type (0: that of the longest slab). Stops if there is none;
/// errors of other recipes are ignored.
[[nodiscard]] Recipe recipe_of_type(const config::Config& config, std::uint16_t slab_type);

}  // namespace slabd::cli
