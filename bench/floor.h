// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

/// Hardware floor: the fastest pass over a scan that only reads it. It is the denominator of every ratio of the
/// benches, so it must not be slow. It uses the widest registers of the machine and enough sums in flight to hide
/// their latency.
namespace slabd::bench {

/// Sum of all floats in unspecified order. `floats` begins on a 64-byte boundary.
[[nodiscard]] float read_pass(std::span<const float> floats);
/// Registers that read_pass uses on this machine: "AVX-512", "AVX2" or "SSE2".
[[nodiscard]] const char* read_pass_registers();

}  // namespace slabd::bench
