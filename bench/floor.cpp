// SPDX-License-Identifier: Apache-2.0
//
// Reads four streams, each a quarter of the array: the hardware prefetchers follow several address sequences at once,
// and one alone does not fill the memory queue. Two sums per stream hide the latency of the additions.
#include "bench/floor.h"

#include <immintrin.h>

#include <cstddef>

namespace slabd::bench {
namespace {

constexpr std::size_t kStreams = 4;
constexpr std::size_t kLine = 16;  ///< floats of a cache line

float sum_tail(std::span<const float> floats, std::size_t from) {
  float sum = 0.0F;
  for (std::size_t i = from; i < floats.size(); ++i) sum += floats[i];
  return sum;
}

/// Floats per stream: whole pairs of lines.
std::size_t stream_floats(std::span<const float> floats) {
  return floats.size() / (kStreams * 2 * kLine) * (2 * kLine);
}

__attribute__((target("avx512f"))) float read_avx512(std::span<const float> floats) {
  const std::size_t each = stream_floats(floats);
  const float* p = floats.data();
  __m512 a0 = _mm512_setzero_ps(), a1 = a0, a2 = a0, a3 = a0, b0 = a0, b1 = a0, b2 = a0, b3 = a0;
  for (std::size_t i = 0; i < each; i += 2 * kLine) {
    a0 = _mm512_add_ps(a0, _mm512_load_ps(p + i));
    b0 = _mm512_add_ps(b0, _mm512_load_ps(p + i + kLine));
    a1 = _mm512_add_ps(a1, _mm512_load_ps(p + each + i));
    b1 = _mm512_add_ps(b1, _mm512_load_ps(p + each + i + kLine));
    a2 = _mm512_add_ps(a2, _mm512_load_ps(p + 2 * each + i));
    b2 = _mm512_add_ps(b2, _mm512_load_ps(p + 2 * each + i + kLine));
    a3 = _mm512_add_ps(a3, _mm512_load_ps(p + 3 * each + i));
    b3 = _mm512_add_ps(b3, _mm512_load_ps(p + 3 * each + i + kLine));
  }
  const __m512 a = _mm512_add_ps(_mm512_add_ps(a0, a1), _mm512_add_ps(a2, a3));
  const __m512 b = _mm512_add_ps(_mm512_add_ps(b0, b1), _mm512_add_ps(b2, b3));
  alignas(64) float lanes[kLine];
  _mm512_store_ps(lanes, _mm512_add_ps(a, b));
  float sum = 0.0F;
  for (const float lane : lanes) sum += lane;
  return sum + sum_tail(floats, kStreams * each);
}

__attribute__((target("avx2"))) float read_avx2(std::span<const float> floats) {
  const std::size_t each = stream_floats(floats);
  const float* p = floats.data();
  __m256 a[kStreams], b[kStreams];
  for (std::size_t s = 0; s < kStreams; ++s) a[s] = b[s] = _mm256_setzero_ps();
  for (std::size_t i = 0; i < each; i += kLine) {
    for (std::size_t s = 0; s < kStreams; ++s) {
      a[s] = _mm256_add_ps(a[s], _mm256_load_ps(p + s * each + i));
      b[s] = _mm256_add_ps(b[s], _mm256_load_ps(p + s * each + i + kLine / 2));
    }
  }
  alignas(32) float lanes[8];
  float sum = 0.0F;
  for (std::size_t s = 0; s < kStreams; ++s) {
    _mm256_store_ps(lanes, _mm256_add_ps(a[s], b[s]));
    for (const float lane : lanes) sum += lane;
  }
  return sum + sum_tail(floats, kStreams * each);
}

float read_sse2(std::span<const float> floats) {
  const std::size_t each = stream_floats(floats);
  const float* p = floats.data();
  __m128 a[kStreams];
  for (__m128& sum : a) sum = _mm_setzero_ps();
  for (std::size_t i = 0; i < each; i += 4)
    for (std::size_t s = 0; s < kStreams; ++s) a[s] = _mm_add_ps(a[s], _mm_load_ps(p + s * each + i));
  alignas(16) float lanes[4];
  float sum = 0.0F;
  for (const __m128& part : a) {
    _mm_store_ps(lanes, part);
    for (const float lane : lanes) sum += lane;
  }
  return sum + sum_tail(floats, kStreams * each);
}

}  // namespace

float read_pass(std::span<const float> floats) {
  if (__builtin_cpu_supports("avx512f")) return read_avx512(floats);
  if (__builtin_cpu_supports("avx2")) return read_avx2(floats);
  return read_sse2(floats);
}

const char* read_pass_registers() {
  if (__builtin_cpu_supports("avx512f")) return "AVX-512";
  return __builtin_cpu_supports("avx2") ? "AVX2" : "SSE2";
}

}  // namespace slabd::bench
