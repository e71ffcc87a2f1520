// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <string>

#include "algo/algo.h"

namespace slabd::testing {

/// Calls `look()` with every instruction set of this machine, and selects the best one at the end.
template <typename Look>
void on_each_set(const Look& look) {
  using enum algo::InstructionSet;
  int seen = 0;
  for (const algo::InstructionSet set : {plain, sse4, avx2, avx512, best}) {
    if (!algo::limit_instruction_set(set)) continue;
    ++seen;
    SCOPED_TRACE(std::string(algo::instruction_set()));
    look();
  }
  EXPECT_GE(seen, 2);
  EXPECT_TRUE(algo::limit_instruction_set(best));
}

}  // namespace slabd::testing
