// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include "config/config.h"
#include "tests/places/places.h"

/// The reference recipe as shipped.
namespace slabd::cli {

inline const std::string kReferenceRecipe = places::source_dir() + "/recipes/p5600.toml";

inline Recipe reference_recipe() {
  Recipe recipe;
  std::vector<config::Problem> problems;
  config::load_recipe(kReferenceRecipe, recipe, problems);
  for (const config::Problem& problem : problems) ADD_FAILURE() << problem.text;
  return recipe;
}

}  // namespace slabd::cli
