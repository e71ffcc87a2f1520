// SPDX-License-Identifier: Apache-2.0
//
// Input: a recipe or a configuration (TOML_RECIPE: 1, 0).
#include "config/config.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;  // NOLINT(google-build-using-namespace)
  static const fuzz::InputFile file(".toml");
  if (size > 20'000) return 0;
  file.write(fuzz::text_of(data, size));
  std::vector<config::Problem> problems;
  if (TOML_RECIPE == 1) {
    Recipe recipe;
    config::load_recipe(file.path(), recipe, problems);
    if (!problems.empty()) return 0;
    fuzz::must(recipe.stations() >= 2 && recipe.stations() <= limits::kStationsMax, "a recipe has 2..18 blocks");
    fuzz::must(!recipe.name.empty() && !recipe.sha256.empty(), "a recipe has a name and a hash");
    fuzz::must(recipe.guard >= 0.0, "a guard band is none or more");
  } else {
    config::Config config;
    config::load_config(file.path(), config, problems);
    if (!problems.empty()) return 0;
    fuzz::must(!config.storage.db_path.empty() && !config.storage.spool_dir.empty(), "there is somewhere to store");
    fuzz::must(config.scan_timeout_ns > 0 && config.settle_timeout_ns > 0, "every wait ends");
    fuzz::must(config.scan_timeout_ns + config.settle_timeout_ns < 20 * kNsPerS, "ACQUIRED within 20 s");
  }
  for (const config::Problem& problem : problems) fuzz::must(!problem.text.empty(), "a problem says what it is");
  return 0;
}
