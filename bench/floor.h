// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

/// What the hardware allows: the fastest pass over a scan that only reads it. Every ratio of the benches has it below
/// the line, so it must not be slow: the widest registers the machine has, enough sums in flight to hide their latency,
/// and nothing else.
namespace slabd::bench {

/// Sum of all floats, in no promised order. `floats` begins on a 64-byte boundary.
[[nodiscard]] float read_pass(std::span<const float> floats);
/// The registers it uses here: "AVX-512", "AVX2" or "SSE2".
[[nodiscard]] const char* read_pass_registers();

}  // namespace slabd::bench
