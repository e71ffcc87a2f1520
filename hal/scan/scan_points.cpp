// SPDX-License-Identifier: Apache-2.0
//
// Problem: five million points must be checked for finite values before the scan may be reported as acquired, and the
// check must cost less than reading. Idea: sixteen points are 48 numbers and 48 bits, one for each NaN. A point is
// missing if any of its three bits is set; nearly always all three are, and no store is needed. The same for zeros:
// three in a row are rare.
#include "hal/scan/scan_points.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "hal/scan/scan_points.cpp"
#include <hwy/foreach_target.h>
// After foreach_target: compiled once for each instruction set.
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>

HWY_BEFORE_NAMESPACE();
namespace slabd::hal {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

constexpr std::size_t kGroupPoints = 16;
constexpr std::size_t kGroupFloats = 3 * kGroupPoints;
using Tag = hn::CappedTag<float, 16>;
constexpr std::size_t kLanes = hn::MaxLanes(Tag());

/// Bit k is lane k of the mask.
HWY_INLINE std::uint64_t bits_of(hn::Mask<Tag> mask) {
  std::array<std::uint8_t, 8> byte{};
  hn::StoreMaskBits(Tag(), mask, byte.data());
  if constexpr (kLanes <= 8) return byte[0];
  std::uint16_t both = 0;
  std::memcpy(&both, byte.data(), sizeof both);
  return both;
}

enum class Store { no, cached, past_caches };

template <Store kStore>
HWY_INLINE Settled settle_group(const float* from, float* to) {
  const Tag tag;
  constexpr std::uint64_t kEvery = 0xFFFF'FFFF'FFFFU;
  constexpr std::uint64_t kEveryX = 0x2492'4924'9249U;
  std::uint64_t number = 0;
  std::uint64_t zero = 0;
  auto infinite = hn::MaskFromVec(hn::Zero(tag));
#pragma GCC unroll 48
  for (std::size_t i = 0; i < kGroupFloats; i += kLanes) {
    const auto v = hn::LoadU(tag, from + i);
    if constexpr (kStore == Store::cached) hn::StoreU(v, tag, to + i);
    if constexpr (kStore == Store::past_caches) hn::Stream(v, tag, to + i);
    number |= bits_of(hn::Eq(v, v)) << i;
    zero |= bits_of(hn::Eq(v, hn::Zero(tag))) << i;
    infinite = hn::Or(infinite, hn::Eq(hn::Abs(v), hn::Set(tag, std::numeric_limits<float>::infinity())));
  }
  const std::uint64_t nan = number ^ kEvery;
  const std::uint64_t missing = (nan | nan >> 1U | nan >> 2U) & kEveryX;
  const std::uint64_t nothing = zero & zero >> 1U & zero >> 2U & kEveryX;
  // Missing points are randomly distributed, so a branch on them would cost more than all of this. A point that is
  // missing in part, infinite or zero is rare; the group is processed again.
  const bool settled = nan == missing * 7 && nothing == 0 && hn::AllFalse(tag, infinite);  // 7: x, y and z
  if (!settled) return slabd::hal::settle_points<float>({to, kGroupFloats});
  return {kGroupPoints - hwy::PopCount(missing), 0};
}

template <Store kStore>
Settled settle(const float* from, std::size_t points, float* to) {
  Settled settled;
  std::size_t i = 0;
  for (; i + kGroupPoints <= points; i += kGroupPoints) settled += settle_group<kStore>(from + 3 * i, to + 3 * i);
  if (kStore != Store::no) std::memcpy(to + 3 * i, from + 3 * i, (points - i) * 3 * sizeof(float));
  settled += slabd::hal::settle_points<float>({to + 3 * i, 3 * (points - i)});
  return settled;
}

}  // namespace

Settled SettleInPlace(float* xyz, std::size_t points) {
  return settle<Store::no>(xyz, points, xyz);
}
Settled MoveAndSettle(const float* from, std::size_t points, float* to) {
  const bool aligned = reinterpret_cast<std::uintptr_t>(to) % (kLanes * sizeof(float)) == 0;
  if (!aligned) return settle<Store::cached>(from, points, to);
  const Settled settled = settle<Store::past_caches>(from, points, to);
  hwy::FlushStream();  // the points are read by another thread
  return settled;
}

void CopyWithOneNan(const float* from, std::size_t count, float* to) {
  const Tag tag;
  const auto one_nan = hn::Set(tag, std::numeric_limits<float>::quiet_NaN());
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    const auto v = hn::LoadU(tag, from + i);
    hn::StoreU(hn::IfThenElse(hn::Eq(v, v), v, one_nan), tag, to + i);
  }
  for (; i < count; ++i) to[i] = from[i] == from[i] ? from[i] : std::numeric_limits<float>::quiet_NaN();
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::hal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::hal {

HWY_EXPORT(SettleInPlace);
HWY_EXPORT(MoveAndSettle);
HWY_EXPORT(CopyWithOneNan);

Settled settle_points(float* xyz, std::size_t points) {
  return HWY_DYNAMIC_DISPATCH(SettleInPlace)(xyz, points);
}

Settled settle_points(double* xyz, std::size_t points) {
  return settle_points<double>({xyz, 3 * points});
}

Settled move_and_settle_points(const char* from, std::size_t points, float* to) {
  // The bytes are floats at any address, which LoadU and memcpy read.
  return HWY_DYNAMIC_DISPATCH(MoveAndSettle)(reinterpret_cast<const float*>(from), points, to);
}

void copy_with_one_nan(const float* from, std::size_t count, float* to) {
  HWY_DYNAMIC_DISPATCH(CopyWithOneNan)(from, count, to);
}

}  // namespace slabd::hal
#endif
