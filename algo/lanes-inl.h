// SPDX-License-Identifier: Apache-2.0
//
// Arithmetic on sixteen numbers at a time, on every machine. A kernel with these types is ordinary arithmetic: a * b +
// c. It is compiled once per instruction set (Highway's foreach_target). Sixteen lanes are one register of AVX-512, two
// of AVX2, four of SSE.
//
// There are sixteen lanes everywhere, each operation rounds once (a product and a sum are never fused), and lanes are
// summed in one fixed order. Therefore every instruction set gives the same bits.
//
// Not a public header of the room: only .cpp files compiled for each instruction set include it, after
// hwy/foreach_target.h.
#if defined(SLABD_ALGO_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SLABD_ALGO_LANES_INL_H_
#undef SLABD_ALGO_LANES_INL_H_
#else
#define SLABD_ALGO_LANES_INL_H_
#endif

#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <array>
#include <cstddef>
#include <cstdint>

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

inline constexpr std::size_t kLanes = 16;

template <typename T>
using Tag = hn::CappedTag<T, kLanes>;
/// Number of registers for sixteen numbers of type T.
template <typename T>
inline constexpr std::size_t kRegisters = kLanes / hn::MaxLanes(Tag<T>());

/// K registers of numbers, as two halves.
template <typename T, std::size_t K>
struct Pack {
  Pack<T, K / 2> lo, hi;
};
template <typename T>
struct Pack<T, 1> {
  hn::Vec<Tag<T>> v;
};
/// K registers of truth values.
template <typename T, std::size_t K>
struct MaskPack {
  MaskPack<T, K / 2> lo, hi;
};
template <typename T>
struct MaskPack<T, 1> {
  hn::Mask<Tag<T>> m;
};

using F16 = Pack<float, kRegisters<float>>;
using D16 = Pack<double, kRegisters<double>>;
using I16 = Pack<std::int32_t, kRegisters<std::int32_t>>;
using M16 = MaskPack<float, kRegisters<float>>;
using MD16 = MaskPack<double, kRegisters<double>>;

// Defines each operation for one register and for two halves.
#define SLABD_LANES_BINARY(name, op)                                     \
  template <typename T>                                                  \
  HWY_INLINE Pack<T, 1> name(const Pack<T, 1>& a, const Pack<T, 1>& b) { \
    return {hn::op(a.v, b.v)};                                           \
  }                                                                      \
  template <typename T, std::size_t K>                                   \
  HWY_INLINE Pack<T, K> name(const Pack<T, K>& a, const Pack<T, K>& b) { \
    return {name(a.lo, b.lo), name(a.hi, b.hi)};                         \
  }
#define SLABD_LANES_UNARY(name, op)                 \
  template <typename T>                             \
  HWY_INLINE Pack<T, 1> name(const Pack<T, 1>& a) { \
    return {hn::op(a.v)};                           \
  }                                                 \
  template <typename T, std::size_t K>              \
  HWY_INLINE Pack<T, K> name(const Pack<T, K>& a) { \
    return {name(a.lo), name(a.hi)};                \
  }
#define SLABD_LANES_COMPARE(name, op)                                        \
  template <typename T>                                                      \
  HWY_INLINE MaskPack<T, 1> name(const Pack<T, 1>& a, const Pack<T, 1>& b) { \
    return {hn::op(a.v, b.v)};                                               \
  }                                                                          \
  template <typename T, std::size_t K>                                       \
  HWY_INLINE MaskPack<T, K> name(const Pack<T, K>& a, const Pack<T, K>& b) { \
    return {name(a.lo, b.lo), name(a.hi, b.hi)};                             \
  }
#define SLABD_LANES_LOGIC(name, op)                                                  \
  template <typename T>                                                              \
  HWY_INLINE MaskPack<T, 1> name(const MaskPack<T, 1>& a, const MaskPack<T, 1>& b) { \
    return {hn::op(a.m, b.m)};                                                       \
  }                                                                                  \
  template <typename T, std::size_t K>                                               \
  HWY_INLINE MaskPack<T, K> name(const MaskPack<T, K>& a, const MaskPack<T, K>& b) { \
    return {name(a.lo, b.lo), name(a.hi, b.hi)};                                     \
  }

SLABD_LANES_BINARY(operator+, Add)
SLABD_LANES_BINARY(operator-, Sub)
SLABD_LANES_BINARY(operator*, Mul)
SLABD_LANES_BINARY(operator/, Div)
/// Minimum and maximum of the machine. The result for one NaN operand differs between machines: pass no NaN.
SLABD_LANES_BINARY(min, Min)
SLABD_LANES_BINARY(max, Max)
SLABD_LANES_BINARY(bit_or, Or)
SLABD_LANES_BINARY(bit_and, And)
SLABD_LANES_BINARY(bit_xor, Xor)
SLABD_LANES_UNARY(abs, Abs)
SLABD_LANES_UNARY(sqrt, Sqrt)
SLABD_LANES_UNARY(floor, Floor)
/// Comparisons with NaN are false.
SLABD_LANES_COMPARE(operator<, Lt)
SLABD_LANES_COMPARE(operator<=, Le)
SLABD_LANES_COMPARE(operator>, Gt)
SLABD_LANES_COMPARE(operator>=, Ge)
SLABD_LANES_COMPARE(operator==, Eq)
SLABD_LANES_LOGIC(operator&, And)
SLABD_LANES_LOGIC(operator|, Or)
/// Lanes of `b` that are not in `a`.
SLABD_LANES_LOGIC(and_not, AndNot)

#undef SLABD_LANES_BINARY
#undef SLABD_LANES_UNARY
#undef SLABD_LANES_COMPARE
#undef SLABD_LANES_LOGIC

// ---- making and storing ----------------------------------------------------------------------------------------

/// The same number in every lane.
template <typename P>
struct Make;
template <typename T>
struct Make<Pack<T, 1>> {
  static HWY_INLINE Pack<T, 1> all(T value) { return {hn::Set(Tag<T>(), value)}; }
  static HWY_INLINE Pack<T, 1> load(const T* from) { return {hn::LoadU(Tag<T>(), from)}; }
};
template <typename T, std::size_t K>
struct Make<Pack<T, K>> {
  using Half = Make<Pack<T, K / 2>>;
  static constexpr std::size_t kHalf = K / 2 * hn::MaxLanes(Tag<T>());
  static HWY_INLINE Pack<T, K> all(T value) { return {Half::all(value), Half::all(value)}; }
  static HWY_INLINE Pack<T, K> load(const T* from) { return {Half::load(from), Half::load(from + kHalf)}; }
};
HWY_INLINE F16 f16(float value) {
  return Make<F16>::all(value);
}
HWY_INLINE D16 d16(double value) {
  return Make<D16>::all(value);
}
HWY_INLINE I16 i16(std::int32_t value) {
  return Make<I16>::all(value);
}
HWY_INLINE F16 load(const float* from) {
  return Make<F16>::load(from);
}
HWY_INLINE D16 load(const double* from) {
  return Make<D16>::load(from);
}
HWY_INLINE I16 load(const std::int32_t* from) {
  return Make<I16>::load(from);
}

template <typename T>
HWY_INLINE void store(const Pack<T, 1>& a, T* to) {
  hn::StoreU(a.v, Tag<T>(), to);
}
template <typename T, std::size_t K>
HWY_INLINE void store(const Pack<T, K>& a, T* to) {
  store(a.lo, to);
  store(a.hi, to + K / 2 * hn::MaxLanes(Tag<T>()));
}

/// The numbers 0, 1, ... 15.
HWY_INLINE F16 lane_numbers() {
  alignas(64) static constexpr float kNumbers[kLanes] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15};
  return load(kNumbers);
}

/// Sixteen points x y z, x y z, ... split into coordinates.
struct Points16 {
  F16 x, y, z;
};
/// The points of one register length are stored in three registers. Three and the number of lanes have no common
/// factor, so no two x have the same lane. Two lane-wise selections collect all x, one permutation orders them.
/// Machines without a permutation of that width use Highway's method.
#if HWY_TARGET <= HWY_AVX2
/// Lanes whose number modulo three is `rest`.
template <typename Tag>
HWY_INLINE hn::Mask<Tag> every_third(Tag tag, std::size_t rest) {
  alignas(64) static constexpr std::int32_t kThirds[kLanes] = {0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0};
  const hn::Rebind<std::int32_t, Tag> whole;
  return hn::RebindMask(tag, hn::Eq(hn::Load(whole, kThirds), hn::Set(whole, static_cast<std::int32_t>(rest))));
}
/// Coordinate c of the points in three registers.
template <std::size_t c, typename Tag, typename V>
HWY_INLINE V every_third_number(Tag tag, const V& v0, const V& v1, const V& v2) {
  constexpr std::size_t kWidth = hn::MaxLanes(Tag());
  struct Order {
    alignas(64) std::int32_t lane[kWidth];
    constexpr Order() : lane() {
      for (std::size_t i = 0; i < kWidth; ++i) lane[i] = static_cast<std::int32_t>((3 * i + c) % kWidth);
    }
  };
  static constexpr Order kOrder;
  const auto from_first = every_third(tag, c);
  const auto from_second = every_third(tag, (c + 2 * kWidth) % 3);
  const V together = hn::IfThenElse(from_first, v0, hn::IfThenElse(from_second, v1, v2));
  return hn::TableLookupLanes(together, hn::SetTableIndices(tag, kOrder.lane));
}
#endif
template <std::size_t K>
HWY_INLINE void take_apart(const float* xyz, Pack<float, K>& x, Pack<float, K>& y, Pack<float, K>& z) {
  if constexpr (K == 1) {
    const Tag<float> tag;
#if HWY_TARGET <= HWY_AVX2
    constexpr std::size_t kWidth = hn::MaxLanes(Tag<float>());
    auto v0 = hn::LoadU(tag, xyz), v1 = hn::LoadU(tag, xyz + kWidth), v2 = hn::LoadU(tag, xyz + 2 * kWidth);
    // Three plain loads instead of nine masked ones: with masked loads the prefetcher does not detect sequential reads,
    // and passes over a scan take twice as long.
    asm("" : "+x"(v0.raw), "+x"(v1.raw), "+x"(v2.raw));
    x.v = every_third_number<0>(tag, v0, v1, v2);
    y.v = every_third_number<1>(tag, v0, v1, v2);
    z.v = every_third_number<2>(tag, v0, v1, v2);
#else
    hn::LoadInterleaved3(tag, xyz, x.v, y.v, z.v);
#endif
  } else {
    take_apart(xyz, x.lo, y.lo, z.lo);
    take_apart(xyz + 3 * (K / 2) * hn::MaxLanes(Tag<float>()), x.hi, y.hi, z.hi);
  }
}
/// Prefetches sixteen points for later use. The memory need not exist.
HWY_INLINE void fetch_points(const float* xyz) {
  for (std::size_t line = 0; line < 3; ++line) hwy::Prefetch(xyz + kLanes * line);
}
/// Loads sixteen points; `xyz` must hold that many.
HWY_INLINE Points16 load_points(const float* xyz) {
  Points16 p;
  take_apart(xyz, p.x, p.y, p.z);
  return p;
}
/// The first `count` (< 16) points; the other lanes are NaN.
HWY_INLINE Points16 load_points(const float* xyz, std::size_t count) {
  alignas(64) float room[3 * kLanes];
  for (std::size_t i = 0; i < 3 * kLanes; ++i) room[i] = i < 3 * count ? xyz[i] : __builtin_nanf("");
  return load_points(room);
}

/// Stores 64 numbers: a[0] b[0] c[0] d[0], a[1] ...
template <std::size_t K>
HWY_INLINE void store_interleaved(const Pack<float, K>& a, const Pack<float, K>& b, const Pack<float, K>& c,
                                  const Pack<float, K>& d, float* to) {
  if constexpr (K == 1) {
    hn::StoreInterleaved4(a.v, b.v, c.v, d.v, Tag<float>(), to);
  } else {
    store_interleaved(a.lo, b.lo, c.lo, d.lo, to);
    store_interleaved(a.hi, b.hi, c.hi, d.hi, to + 4 * (K / 2) * hn::MaxLanes(Tag<float>()));
  }
}
/// Stores 32 numbers: a[0] b[0], a[1] ...
template <std::size_t K>
HWY_INLINE void store_interleaved(const Pack<float, K>& a, const Pack<float, K>& b, float* to) {
  if constexpr (K == 1) {
    hn::StoreInterleaved2(a.v, b.v, Tag<float>(), to);
  } else {
    store_interleaved(a.lo, b.lo, to);
    store_interleaved(a.hi, b.hi, to + 2 * (K / 2) * hn::MaxLanes(Tag<float>()));
  }
}

// ---- masks -----------------------------------------------------------------------------------------------------

/// Mask as a word: bit k is lane k.
template <typename T>
HWY_INLINE std::uint32_t bits(const MaskPack<T, 1>& mask) {
  if constexpr (hn::MaxLanes(Tag<T>()) == kLanes) {
    std::uint16_t word = 0;
    hn::StoreMaskBits(Tag<T>(), mask.m, reinterpret_cast<std::uint8_t*>(&word));
    return word;
  } else {
    // StoreMaskBits may write up to eight bytes.
    std::array<std::uint8_t, 8> byte{};
    hn::StoreMaskBits(Tag<T>(), mask.m, byte.data());
    return byte[0];
  }
}
template <typename T, std::size_t K>
HWY_INLINE std::uint32_t bits(const MaskPack<T, K>& mask) {
  return bits(mask.lo) | (bits(mask.hi) << (K / 2 * hn::MaxLanes(Tag<T>())));
}

template <typename T>
HWY_INLINE Pack<T, 1> select(const MaskPack<T, 1>& mask, const Pack<T, 1>& yes, const Pack<T, 1>& no) {
  return {hn::IfThenElse(mask.m, yes.v, no.v)};
}
template <typename T, std::size_t K>
HWY_INLINE Pack<T, K> select(const MaskPack<T, K>& mask, const Pack<T, K>& yes, const Pack<T, K>& no) {
  return {select(mask.lo, yes.lo, no.lo), select(mask.hi, yes.hi, no.hi)};
}
/// `a` where the mask is set, zero elsewhere.
template <typename T>
HWY_INLINE Pack<T, 1> keep(const MaskPack<T, 1>& mask, const Pack<T, 1>& a) {
  return {hn::IfThenElseZero(mask.m, a.v)};
}
template <typename T, std::size_t K>
HWY_INLINE Pack<T, K> keep(const MaskPack<T, K>& mask, const Pack<T, K>& a) {
  return {keep(mask.lo, a.lo), keep(mask.hi, a.hi)};
}

// ---- whole numbers -------------------------------------------------------------------------------------------

/// Arithmetic shift by k bits.
template <int k>
HWY_INLINE Pack<std::int32_t, 1> shift_right(const Pack<std::int32_t, 1>& a) {
  return {hn::ShiftRight<k>(a.v)};
}
template <int k, std::size_t K>
HWY_INLINE Pack<std::int32_t, K> shift_right(const Pack<std::int32_t, K>& a) {
  return {shift_right<k>(a.lo), shift_right<k>(a.hi)};
}
/// Arithmetic shift of each lane by its own count, 0 to 31 bits.
HWY_INLINE Pack<std::int32_t, 1> shift_right(const Pack<std::int32_t, 1>& a, const Pack<std::int32_t, 1>& by) {
  return {hn::Shr(a.v, by.v)};
}
template <std::size_t K>
HWY_INLINE Pack<std::int32_t, K> shift_right(const Pack<std::int32_t, K>& a, const Pack<std::int32_t, K>& by) {
  return {shift_right(a.lo, by.lo), shift_right(a.hi, by.hi)};
}
/// Left shift of each lane by its own count, 0 to 31 bits.
HWY_INLINE Pack<std::int32_t, 1> shift_left(const Pack<std::int32_t, 1>& a, const Pack<std::int32_t, 1>& by) {
  return {hn::Shl(a.v, by.v)};
}
template <std::size_t K>
HWY_INLINE Pack<std::int32_t, K> shift_left(const Pack<std::int32_t, K>& a, const Pack<std::int32_t, K>& by) {
  return {shift_left(a.lo, by.lo), shift_left(a.hi, by.hi)};
}
/// OR of all lanes.
template <std::size_t K>
HWY_INLINE std::uint32_t any_bits(const Pack<std::int32_t, K>& a) {
  if constexpr (K > 1) {
    return any_bits(bit_or(a.lo, a.hi));
  } else {
    alignas(64) std::array<std::int32_t, kLanes> lane;
    store(a, lane.data());
    std::uint32_t all = 0;
    for (std::size_t i = 0; i < hn::MaxLanes(Tag<std::int32_t>()); ++i) all |= static_cast<std::uint32_t>(lane[i]);
    return all;
  }
}
/// Lanes in which bit `one` is set.
HWY_INLINE MaskPack<float, 1> test_bits(const Pack<std::int32_t, 1>& a, const Pack<std::int32_t, 1>& one) {
  return {hn::RebindMask(Tag<float>(), hn::TestBit(a.v, one.v))};
}
template <std::size_t K>
HWY_INLINE MaskPack<float, K> test_bits(const Pack<std::int32_t, K>& a, const Pack<std::int32_t, K>& one) {
  return {test_bits(a.lo, one.lo), test_bits(a.hi, one.hi)};
}
HWY_INLINE MaskPack<float, 1> is_zero(const Pack<std::int32_t, 1>& a) {
  return {hn::RebindMask(Tag<float>(), hn::Eq(a.v, hn::Zero(Tag<std::int32_t>())))};
}
template <std::size_t K>
HWY_INLINE MaskPack<float, K> is_zero(const Pack<std::int32_t, K>& a) {
  return {is_zero(a.lo), is_zero(a.hi)};
}
/// `a` where the mask is set, zero elsewhere.
HWY_INLINE Pack<std::int32_t, 1> keep_int(const MaskPack<float, 1>& mask, const Pack<std::int32_t, 1>& a) {
  return {hn::IfThenElseZero(hn::RebindMask(Tag<std::int32_t>(), mask.m), a.v)};
}
template <std::size_t K>
HWY_INLINE Pack<std::int32_t, K> keep_int(const MaskPack<float, K>& mask, const Pack<std::int32_t, K>& a) {
  return {keep_int(mask.lo, a.lo), keep_int(mask.hi, a.hi)};
}
/// Lanes in which `a` and `wanted` have a bit in common.
template <std::size_t K>
HWY_INLINE MaskPack<float, K> has_bits(const Pack<std::int32_t, K>& a, const Pack<std::int32_t, K>& wanted) {
  if constexpr (K == 1) {
    const Tag<std::int32_t> tag;
    return {hn::RebindMask(Tag<float>(), hn::Ne(hn::And(a.v, wanted.v), hn::Zero(tag)))};
  } else {
    return {has_bits(a.lo, wanted.lo), has_bits(a.hi, wanted.hi)};
  }
}
/// Mask whose lane k is set if bit k is set.
HWY_INLINE M16 lanes_of(std::uint32_t bits) {
  alignas(64) static constexpr std::int32_t kBits[kLanes] = {1,       1 << 1,  1 << 2,  1 << 3, 1 << 4,  1 << 5,
                                                             1 << 6,  1 << 7,  1 << 8,  1 << 9, 1 << 10, 1 << 11,
                                                             1 << 12, 1 << 13, 1 << 14, 1 << 15};
  return has_bits(load(kBits), i16(static_cast<std::int32_t>(bits)));
}
template <typename T>
HWY_INLINE bool any(const MaskPack<T, 1>& mask) {
  return !hn::AllFalse(Tag<T>(), mask.m);
}
template <typename T, std::size_t K>
HWY_INLINE bool any(const MaskPack<T, K>& mask) {
  return any(mask.lo) || any(mask.hi);
}

/// Stores the set lanes contiguously and returns their number. Up to sixteen numbers from `to` on may change.
template <typename T>
HWY_INLINE std::size_t store_set(const MaskPack<T, 1>& mask, const Pack<T, 1>& a, T* to) {
  hn::StoreU(hn::Compress(a.v, mask.m), Tag<T>(), to);
  return hn::CountTrue(Tag<T>(), mask.m);
}
template <typename T, std::size_t K>
HWY_INLINE std::size_t store_set(const MaskPack<T, K>& mask, const Pack<T, K>& a, T* to) {
  const std::size_t low = store_set(mask.lo, a.lo, to);
  return low + store_set(mask.hi, a.hi, to + low);
}

// ---- between types ---------------------------------------------------------------------------------------------

/// Converts towards zero. The result is unspecified if an int cannot hold it, so limit the value first.
template <std::size_t K>
HWY_INLINE Pack<std::int32_t, K> to_int(const Pack<float, K>& a) {
  if constexpr (K == 1)
    return {hn::ConvertTo(Tag<std::int32_t>(), a.v)};
  else
    return {to_int(a.lo), to_int(a.hi)};
}
template <std::size_t K>
HWY_INLINE Pack<float, K> to_float(const Pack<std::int32_t, K>& a) {
  if constexpr (K == 1)
    return {hn::ConvertTo(Tag<float>(), a.v)};
  else
    return {to_float(a.lo), to_float(a.hi)};
}
/// Converts exactly.
template <std::size_t K>
HWY_INLINE auto to_double(const Pack<float, K>& a) {
  if constexpr (K > 1) {
    using Half = decltype(to_double(a.lo));
    return Pack<double, 2 * sizeof(Half) / sizeof(Pack<double, 1>)>{to_double(a.lo), to_double(a.hi)};
  } else {
#if HWY_TARGET == HWY_SCALAR
    return Pack<double, 1>{hn::PromoteTo(Tag<double>(), a.v)};
#else
    return Pack<double, 2>{{hn::PromoteTo(Tag<double>(), hn::LowerHalf(a.v))},
                           {hn::PromoteTo(Tag<double>(), hn::UpperHalf(hn::Half<Tag<float>>(), a.v))}};
#endif
  }
}

/// Rounds to the nearest float.
template <std::size_t K>
HWY_INLINE auto to_float(const Pack<double, K>& a) {
  if constexpr (sizeof(Pack<double, K>) > 2 * sizeof(Pack<double, 1>) || HWY_TARGET == HWY_SCALAR) {
    if constexpr (K == 1) {
      return Pack<float, 1>{hn::DemoteTo(Tag<float>(), a.v)};
    } else {
      using Half = decltype(to_float(a.lo));
      return Pack<float, 2 * sizeof(Half) / sizeof(Pack<float, 1>)>{to_float(a.lo), to_float(a.hi)};
    }
  } else {
#if HWY_TARGET != HWY_SCALAR
    const hn::Half<Tag<float>> half;
    return Pack<float, 1>{hn::Combine(Tag<float>(), hn::DemoteTo(half, a.hi.v), hn::DemoteTo(half, a.lo.v))};
#endif
  }
}

/// The bits of a float, as an integer.
template <std::size_t K>
HWY_INLINE Pack<std::int32_t, K> pattern(const Pack<float, K>& a) {
  if constexpr (K == 1)
    return {hn::BitCast(Tag<std::int32_t>(), a.v)};
  else
    return {pattern(a.lo), pattern(a.hi)};
}

/// Gathers base[index] in every lane. `base`: 32-bit numbers.
template <typename T, std::size_t K>
HWY_INLINE Pack<T, K> gather(const T* base, const Pack<std::int32_t, K>& index) {
  if constexpr (K == 1)
    return {hn::GatherIndex(Tag<T>(), base, index.v)};
  else
    return {gather(base, index.lo), gather(base, index.hi)};
}

// ---- sums over the lanes ---------------------------------------------------------------------------------------

/// Sum in double, in one fixed order: lane k + 8 to lane k, then k + 4, k + 2, k + 1.
template <typename T, std::size_t K>
HWY_INLINE double sum_of_lanes(const Pack<T, K>& a) {
  alignas(64) std::array<T, kLanes> lane;
  store(a, lane.data());
  std::array<double, kLanes> sum;
  for (std::size_t i = 0; i < kLanes; ++i) sum[i] = static_cast<double>(lane[i]);
  for (std::size_t half = kLanes / 2; half > 0; half /= 2)
    for (std::size_t i = 0; i < half; ++i) sum[i] += sum[i + half];
  return sum[0];
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#endif
