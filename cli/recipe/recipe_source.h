// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <list>
#include <string>
#include <string_view>
#include <vector>

#include "base/recipe.h"
#include "config/config.h"
#include "storage/storage.h"

/// Recipes that are no files any more: the database keeps what slabs were begun with.
namespace slabd::cli {

/// "slab:SLAB" (the recipe that this slab was begun with) or "sha:PREFIX" instead of a file's path.
[[nodiscard]] bool names_stored_recipe(std::string_view word);
/// Stops if there is none such.
[[nodiscard]] storage::RecipeText stored_recipe(storage::Reader& reader, const std::string& word);
/// A kept text as the daemon read it; its path is `sha:` and the whole SHA-256. False: it is no good recipe for this
/// slabd, or not what its SHA-256 says; printed.
[[nodiscard]] bool recipe_from(const storage::RecipeText& text, Recipe& recipe);

/// A file, or what `stored_recipe` finds in `reader` (not null for such a word). Stops if it is no good recipe.
[[nodiscard]] Recipe recipe_named(storage::Reader* reader, const std::string& word);

/// The recipes of a folder and, behind them, those of the database.
class RecipeShelf {
 public:
  explicit RecipeShelf(std::vector<Recipe> of_folder);

  /// The very recipe that the slab was begun with, out of the folder if it is there, else of the database; nullptr: it
  /// is in neither. As long as the shelf lives. journal_write: the database cannot be read.
  [[nodiscard]] Result<const Recipe*> very(const SlabHeader& slab, storage::Reader& reader);
  /// The first one of the folder with the slab's type and size; nullptr: none.
  [[nodiscard]] const Recipe* of_type(const SlabHeader& slab) const;

 private:
  std::vector<Recipe> of_folder_;
  std::list<Recipe> of_database_;
};

/// The recipe that the daemon will use for this slab type (0: that of the longest slab).
/// Stops if there is none; faults of other recipes are ignored.
[[nodiscard]] Recipe recipe_of_type(const daemon::Config& config, std::uint16_t slab_type);

}  // namespace slabd::cli
