// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <new>
#include <vector>

#include "algo/algo.h"
#include "scene.h"

// Sanitizers own malloc; there only operator new is watched. Volatile, because a compiler knows what malloc does and
// would otherwise not look at the counter again.
namespace {
volatile std::size_t g_allocations = 0;
}
#if !defined(__SANITIZE_ADDRESS__)
extern "C" {
void* __libc_malloc(std::size_t size);  // NOLINT
void* malloc(std::size_t size) {
  g_allocations = g_allocations + 1;
  return __libc_malloc(size);
}
}
#else
void* operator new(std::size_t size) {
  g_allocations = g_allocations + 1;
  if (void* p = std::malloc(size)) return p;
  std::abort();
}
void operator delete(void* p) noexcept {
  std::free(p);
}
void operator delete(void* p, std::size_t) noexcept {
  std::free(p);
}
#endif

namespace slabd::algo {
namespace {

TEST(NoHeap, TheCountingBites) {
  const std::size_t before = g_allocations;
  std::vector<BlockResult> some(2);
  some.resize(10);
  const std::size_t after = g_allocations;
  EXPECT_EQ(after, before + 2);
}

TEST(NoHeap, MeasuringABlockAndASlabAllocatesNothing) {
  scene::Cloud cloud = scene::take({}, {});
  const Recipe recipe = scene::p5600();
  BlockInspector inspector;
  std::vector<BlockResult> blocks(18);
  SlabResult slab;

  const std::size_t before = g_allocations;
  inspector.use(recipe);
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  Cloud view = cloud.view();
  const bool ok =
      inspector.denoise(view).ok() && inspector.register_to_model(view).ok() && inspector.extract(view).ok();
  inspector.judge(Code::ok);
  for (int station = 1; station <= 18; ++station) {
    BlockResult& block = blocks[static_cast<std::size_t>(station - 1)];
    block = inspector.result();
    const Pose T = T_slab_block(recipe, station);
    block.observation.p_base = T * block.observation.p_base;
    block.observation.n_base = T.rotation * block.observation.n_base;
    block.observation.jaw_outer_base = T * block.observation.jaw_outer_base;
  }
  inspect_slab(recipe, blocks, {0.02, 1e-5}, Pose::identity(), slab);
  const std::size_t after = g_allocations;

  EXPECT_TRUE(ok);
  EXPECT_EQ(after, before);
  EXPECT_TRUE(slab.fit.ok);
}

}  // namespace
}  // namespace slabd::algo
