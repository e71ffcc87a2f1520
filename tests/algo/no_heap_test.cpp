// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <new>
#include <vector>

#include "algo/algo.h"
#include "base/prng.h"
#include "scene.h"

// A sanitizer replaces malloc and offers a hook instead. Volatile, because compilers have built-in knowledge of malloc
// and would otherwise not reload the counter.
namespace {
volatile std::size_t g_allocations = 0;
}
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
extern "C" {
void* __libc_malloc(std::size_t size);  // NOLINT
void* malloc(std::size_t size) {
  g_allocations = g_allocations + 1;
  return __libc_malloc(size);
}
}
#else
// From the sanitizers' allocator interface, whose header GCC does not install.
extern "C" int __sanitizer_install_malloc_and_free_hooks(void (*on_malloc)(const volatile void*,
                                                                           std::size_t),  // NOLINT
                                                         void (*on_free)(const volatile void*));
namespace {
void on_malloc(const volatile void*, std::size_t) {
  g_allocations = g_allocations + 1;
}
void on_free(const volatile void*) {}
[[maybe_unused]] const int g_hooked = __sanitizer_install_malloc_and_free_hooks(on_malloc, on_free);
}  // namespace
#endif

namespace slabd::algo {
namespace {

TEST(NoHeap, reports_an_allocation_while_it_counts) {
  const std::size_t before = g_allocations;
  std::vector<BlockResult> some(2);
  some.resize(10);
  const std::size_t after = g_allocations;
  EXPECT_EQ(after, before + 2);
}

TEST(NoHeap, measuring_a_block_and_a_slab_does_not_allocate) {
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

TEST(NoHeap, sorting_a_scan_does_not_allocate) {
  const scene::Cloud drawn = scene::take({}, {});
  const Recipe recipe = scene::p5600();
  BlockInspector inspector(2);
  inspector.use(recipe);
  // Few points share a cell; then too many for a lattice.
  for (const std::size_t every : {std::size_t{400}, std::size_t{20}}) {
    scene::Cloud cloud = drawn;
    for (std::size_t i = 0; i < drawn.xyz.size(); i += 3 * every)
      cloud.xyz.insert(cloud.xyz.end(), {drawn.xyz[i], drawn.xyz[i + 1], drawn.xyz[i + 2] + 0.02F});
    Prng prng(1);
    const auto at = [&](std::size_t i) { return cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * i); };
    for (std::size_t i = cloud.xyz.size() / 3; i > 1; --i) std::swap_ranges(at(i - 1), at(i), at(prng.below(i)));
    Cloud view = cloud.view();
    cloud.xyz.resize(3 * limits::kScanPointsMax);
    view.xyz = cloud.xyz;

    const std::size_t before = g_allocations;
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    const bool ok =
        inspector.denoise(view).ok() && inspector.register_to_model(view).ok() && inspector.extract(view).ok();
    const std::size_t after = g_allocations;

    EXPECT_TRUE(ok) << every;
    EXPECT_EQ(after, before) << every;
  }
}

}  // namespace
}  // namespace slabd::algo
