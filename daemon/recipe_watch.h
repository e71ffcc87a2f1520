// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/fixed.h"
#include "base/recipe.h"
#include "storage/storage.h"

/// The recipe folder while slabd runs. Recipes are read at the start and stay in force; a file that is changed later is
/// not used until it is taken up. A thread of its own looks at the folder, because a share that hangs must not hold the
/// loop, and compares the files with what is in use.
namespace slabd::daemon {

/// What the station, the measuring and the database work with. Never changed once it is in use.
struct RecipeSet {
  std::vector<Recipe> recipes;
  std::vector<storage::RecipeText> texts;  ///< of their files, in the same order
};

struct RecipeDifference {
  std::string file;  ///< its name in the folder
  std::string what;  ///< "changed", "missing", "new"
  /// "items.jaw_distance.upper: 0.5 in use, 0.15 in the file". Empty: no key differs, or the file is not changed.
  std::vector<std::string> keys;
  std::string problem;  ///< why the file could not be used as it is now
};

class RecipeWatch {
 public:
  using Text = FixedString<limits::kErrorTextBytes>;
  enum class Reload : std::uint8_t { none, checking, checked, refused, done };

  /// `in_use` was read from `dir`. A look about every `period_ms`.
  RecipeWatch(const std::string& dir, std::shared_ptr<const RecipeSet> in_use, int period_ms = 2'000);
  /// Does not wait for a look that hangs.
  ~RecipeWatch();
  RecipeWatch(const RecipeWatch&) = delete;
  RecipeWatch& operator=(const RecipeWatch&) = delete;

  // None of these waits for the folder; from any thread, but the loop's are one thread's.
  [[nodiscard]] bool differs() const;
  /// One sentence with the first file and key that differ; empty when nothing does.
  [[nodiscard]] Text words() const;
  [[nodiscard]] std::vector<RecipeDifference> differences() const;

  /// Has the folder read and checked, to be taken up. False: that is under way.
  [[nodiscard]] bool order_reload();
  [[nodiscard]] Reload reload() const;
  [[nodiscard]] Text reload_text() const;  ///< why it was refused
  /// For the loop: what was ordered and is good. Then one of the two below is called. Nullptr: nothing waits.
  [[nodiscard]] std::shared_ptr<const RecipeSet> checked() const;
  void taken_up();
  void refuse(std::string_view why);
  /// A sentence for the log, once: why a reload was refused.
  [[nodiscard]] bool next_note(Text& text);
  [[nodiscard]] std::shared_ptr<const RecipeSet> in_use() const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace slabd::daemon
