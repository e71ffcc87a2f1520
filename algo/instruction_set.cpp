// SPDX-License-Identifier: Apache-2.0
#include <hwy/highway.h>
#include <hwy/targets.h>

#include "algo/algo.h"

namespace slabd::algo {
namespace {

/// Highway's target bits of a set. HWY_TARGETS are those for which the kernels were compiled.
std::int64_t targets_of(InstructionSet set) {
  switch (set) {
    case InstructionSet::best: return 0;
    case InstructionSet::avx512: return HWY_AVX3;
    case InstructionSet::avx2: return HWY_AVX2;
    case InstructionSet::sse4: return HWY_SSE4;
    case InstructionSet::plain: return HWY_STATIC_TARGET;
  }
  return 0;
}

}  // namespace

bool limit_instruction_set(InstructionSet set) {
  hwy::SetSupportedTargetsForTest(0);
  const std::int64_t wanted = targets_of(set);
  const std::int64_t here = hwy::SupportedTargets() & HWY_TARGETS;
  if (wanted != 0 && (here & wanted) == 0) {
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    return false;
  }
  if (wanted != 0) hwy::SetSupportedTargetsForTest(wanted | HWY_STATIC_TARGET);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return true;
}

std::string_view instruction_set() {
  // The best target has the lowest bit.
  const std::int64_t here = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(here & -here);
}

}  // namespace slabd::algo
