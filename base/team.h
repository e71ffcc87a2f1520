// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <thread>
#include <type_traits>

namespace slabd {

/// One or two threads that share numbered blocks of work. Either thread may execute a block, so each block writes its
/// result to a place of its own. The caller merges the results in the order of the blocks, which gives the same bits on
/// one thread and on two.
class Team {
 public:
  /// Creates a team of the calling thread and threads - 1 helpers (1 or 2 in total; other values are clamped).
  explicit Team(int threads);
  ~Team();
  Team(const Team&) = delete;
  Team& operator=(const Team&) = delete;

  [[nodiscard]] int threads() const { return helper_.joinable() ? 2 : 1; }

  /// Calls f(block) once for each block from 0 to blocks - 1 and returns when all are done. Calls must not be nested.
  /// No heap. A waiting helper spins for about 0.2 ms, then sleeps; waking it costs about 10 us, so blocks should be
  /// larger than that.
  template <typename F>
  void run(std::size_t blocks, F&& f) {
    run_erased(
        blocks, [](void* context, std::size_t block) { (*static_cast<std::remove_reference_t<F>*>(context))(block); },
        const_cast<void*>(static_cast<const void*>(std::addressof(f))));
  }

 private:
  using Call = void (*)(void* context, std::size_t block);
  void run_erased(std::size_t blocks, Call call, void* context);
  void take_blocks();
  void help();

  Call call_ = nullptr;
  void* context_ = nullptr;
  std::size_t blocks_ = 0;
  std::atomic<std::size_t> next_{0};
  /// Number of the current job, and of the last job finished by the helper; `stop_` ends the helper.
  std::atomic<std::uint32_t> job_{0};
  std::atomic<std::uint32_t> done_{0};
  std::atomic<bool> stop_{false};
  std::thread helper_;
};

}  // namespace slabd
