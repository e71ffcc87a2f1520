// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/fixed.h"
#include "base/recipe.h"
#include "storage/storage.h"

/// Watches the recipe folder while slabd runs. Recipes are read at the start and stay in force; a file that is changed
/// later is used only after a reload. A separate thread reads the folder and compares the files with the recipes in
/// use, because a share that hangs must not block the loop.
namespace slabd::daemon {

/// Recipes used by the station, the measuring and the database. Immutable once in use.
struct RecipeSet {
  std::vector<Recipe> recipes;
  std::vector<storage::RecipeText> texts;  ///< the texts of their files, in the same order
};

struct RecipeDifference {
  std::string file;  ///< its name in the folder
  std::string what;  ///< "changed", "missing", "new"
  /// "items.jaw_distance.upper: 0.5 in use, 0.15 in the file". Empty if no key differs, or if the file is not
  /// "changed".
  std::vector<std::string> keys;
  std::string problem;  ///< why the file could not be used in its present state
};

class RecipeWatch {
 public:
  using Text = FixedString<limits::kErrorTextBytes>;
  enum class Reload : std::uint8_t { none, checking, checked, refused, done };

  /// `in_use` was read from `dir`. The folder is checked about every `period_ms`. `gauges` of the line: a reload checks
  /// formulas against them.
  RecipeWatch(const std::string& dir, std::shared_ptr<const RecipeSet> in_use, int period_ms = 2'000,
              const GaugeList& gauges = kNoGauges);
  /// Does not wait for a check that hangs.
  ~RecipeWatch();
  RecipeWatch(const RecipeWatch&) = delete;
  RecipeWatch& operator=(const RecipeWatch&) = delete;

  // None of these waits for the folder. They may be called from any thread; those for the loop only from one.
  [[nodiscard]] bool differs() const;
  /// One sentence with the first file and key that differ; empty if all are equal.
  [[nodiscard]] Text words() const;
  [[nodiscard]] std::vector<RecipeDifference> differences() const;

  /// Orders the folder to be read and checked for a reload. False if a reload is in progress.
  [[nodiscard]] bool order_reload();
  [[nodiscard]] Reload reload() const;
  [[nodiscard]] Text reload_text() const;  ///< why the reload was refused
  /// For the loop: the recipes of an ordered reload that passed the checks; nullptr if there are none. Afterwards one
  /// of the two functions below must be called.
  [[nodiscard]] std::shared_ptr<const RecipeSet> checked() const;
  void taken_up();
  void refuse(std::string_view why);
  /// A sentence for the log, returned once: why a reload was refused.
  [[nodiscard]] bool next_note(Text& text);
  [[nodiscard]] std::shared_ptr<const RecipeSet> in_use() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace slabd::daemon
