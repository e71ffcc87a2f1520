// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/packed_points.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>

// Problem: the float32 coordinates of a scan look random to a general compressor (1.2 to 1), because each holds ten
// bits of noise. Idea: predict each number from its neighbours, so that only the noise remains, and collect the bytes
// of equal weight, so that the entropy coder sees the zeros together. A scanner measures along the rays of its camera:
// x/z and y/z change smoothly from point to point, whatever the noise of z. x and y predicted from z and this ratio
// leave two bits each instead of twelve.
//
// Each block is coded alone. x and y use the rays only where that is shorter: a parallel projection, or a scan whose
// origin is not the centre of the rays, is predicted from the neighbour on the left.
//
// Invariants: the numbers are mapped one to one to integers and subtracted modulo 2^32, so any bits come back, also
// NaN, -0 and text. Both directions compute a prediction by the same function from the same values. It uses only +, -,
// *, / of double and one rounding to float, which IEEE 754 defines to the last bit (-ffp-contract=off).
namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "the records are little-endian");

/// Maps the bits of a float to an integer in the order of the numbers; -0 is next to 0.
std::uint32_t in_order(std::uint32_t bits) {
  return (bits >> 31U) != 0 ? ~bits : bits | 0x8000'0000U;
}
std::uint32_t bits_of(std::uint32_t ordered) {
  return (ordered >> 31U) != 0 ? ordered & 0x7FFF'FFFFU : ~ordered;
}
constexpr std::uint32_t kZeroInOrder = 0x8000'0000U;

double number_of(std::uint32_t ordered) {
  return static_cast<double>(std::bit_cast<float>(bits_of(ordered)));
}

/// Small differences of either sign become small numbers.
std::uint32_t zigzag(std::uint32_t difference) {
  return (difference << 1U) ^ ((difference >> 31U) != 0 ? 0xFFFF'FFFFU : 0U);
}
std::uint32_t from_zigzag(std::uint32_t residual) {
  return (residual >> 1U) ^ ((residual & 1U) != 0 ? 0xFFFF'FFFFU : 0U);
}

std::uint32_t word_at(std::span<const std::byte> records, std::size_t at) {
  std::uint32_t word = 0;
  std::memcpy(&word, &records[at], sizeof word);
  return word;
}

double ratio_of(std::uint32_t ordered, double depth) {
  return depth == 0.0 ? 0.0 : number_of(ordered) / depth;
}

}  // namespace

/// Calls use(i, left, up, corner) for each point: whether it has a neighbour on the left, above, and left above in this
/// block. The first point of a row has none on the left if it has one above.
template <typename Use>
void PointPlanes::walk(Use use) const {
  const std::size_t row = record_.row;
  std::size_t column = row == 0 ? 0 : static_cast<std::size_t>(first_ % row);
  for (std::size_t i = 0; i < points_; ++i) {
    const bool up = row != 0 && i >= row;
    const bool left = i > 0 && !(column == 0 && up);
    use(i, left, up, left && up && i > row);
    if (++column == row) column = 0;
  }
}

std::uint32_t PointPlanes::predicted(std::size_t i, bool left, bool up) const {
  return left ? values_[i - 1] : up ? values_[i - record_.row] : kZeroInOrder;
}

std::uint32_t PointPlanes::predicted_by_ray(std::size_t i, bool left, bool up, bool corner,
                                            std::uint32_t otherwise) const {
  if (!left && !up) return otherwise;
  const std::size_t row = record_.row;
  const double ratio = corner ? ratio_[i - 1] + ratio_[i - row] - ratio_[i - row - 1]
                       : left ? ratio_[i - 1]
                              : ratio_[i - row];
  const double value = ratio * depth_[i];
  // False for NaN too.
  if (!(std::abs(value) <= static_cast<double>(std::numeric_limits<float>::max()))) return otherwise;
  return in_order(std::bit_cast<std::uint32_t>(static_cast<float>(value)));
}

std::size_t PointPlanes::word_in_order(std::size_t place) const {
  const std::size_t z = record_.xyz[2];
  if (place == 0) return z;
  return place - 1 < z ? place - 1 : place;
}

bool PointPlanes::is_coordinate(std::size_t word) const {
  return std::find(record_.xyz.begin(), record_.xyz.end(), word) != record_.xyz.end();
}

void PointPlanes::begin(std::size_t points, std::uint64_t first) {
  points_ = points;
  first_ = first;
  missing_count_ = 0;
  mask_.assign((points + 7) / 8, 0);
  values_.resize(points);
  depth_.resize(points);
  ratio_.resize(points);
}

/// z of the block, after its word was coded. A missing point has that of its neighbour.
void PointPlanes::keep_depth() {
  std::transform(values_.begin(), values_.end(), depth_.begin(), number_of);
}

// ---- to planes ---------------------------------------------------------------------------------------------------

void PointPlanes::find_missing(std::span<const std::byte> records, PointCoding& coding) {
  const auto kind_of = [&](std::size_t i) {
    const std::uint32_t word = word_at(records, i * record_.bytes() + std::size_t{4} * record_.xyz[0]);
    for (const std::size_t axis : {std::size_t{1}, std::size_t{2}})
      if (word_at(records, i * record_.bytes() + std::size_t{4} * record_.xyz[axis]) != word)
        return kMissingWords.size();
    return static_cast<std::size_t>(std::find(kMissingWords.begin(), kMissingWords.end(), word) -
                                    kMissingWords.begin());
  };
  std::array<std::size_t, kMissingWords.size() + 1> count{};
  for (std::size_t i = 0; i < points_; ++i) ++count[kind_of(i)];
  const auto most = std::max_element(count.begin(), count.end() - 1);
  coding.missing = static_cast<std::uint8_t>(most - count.begin());
  missing_count_ = *most;
  if (missing_count_ == 0) return;
  for (std::size_t i = 0; i < points_; ++i)
    if (kind_of(i) == coding.missing) mask_[i / 8] = static_cast<std::uint8_t>(mask_[i / 8] | 1U << (i % 8));
}

void PointPlanes::add_planes(std::span<const std::uint32_t> residuals) {
  for (unsigned shift = 0; shift < 32; shift += 8) {
    const std::size_t begin = bytes_.size();
    for (const std::uint32_t residual : residuals) bytes_.push_back(static_cast<std::byte>(residual >> shift));
    planes_.push_back(std::span(bytes_).subspan(begin));
  }
}

/// Estimated bits of the planes of these residuals, by the frequency of each byte in its plane. Every fourth point is
/// enough.
double estimated_bits(std::span<const std::uint32_t> residuals) {
  constexpr std::size_t kStep = 4;
  std::array<std::array<std::uint32_t, 256>, 4> count{};
  std::size_t counted = 0;
  for (std::size_t i = 0; i < residuals.size(); i += kStep, ++counted)
    for (unsigned plane = 0; plane < 4; ++plane) ++count[plane][residuals[i] >> (8 * plane) & 0xFFU];
  double bits = 0.0;
  for (const auto& plane : count)
    for (const std::uint32_t n : plane)
      if (n > 0) bits += n * std::log2(static_cast<double>(counted) / n);
  return bits;
}

/// Adds the planes of a word; returns true if it was predicted along the rays.
bool PointPlanes::split_word(std::span<const std::byte> records, std::size_t word, bool may_use_rays) {
  by_left_.clear();
  by_ray_.clear();
  const bool coordinate = is_coordinate(word);
  walk([&](std::size_t i, bool left, bool up, bool corner) {
    const std::uint32_t prediction = predicted(i, left, up);
    const bool is_left_out = coordinate && is_missing(i);
    values_[i] = is_left_out ? prediction : in_order(word_at(records, i * record_.bytes() + 4 * word));
    if (!is_left_out) by_left_.push_back(zigzag(values_[i] - prediction));
    if (!may_use_rays) return;
    ratio_[i] = ratio_of(values_[i], depth_[i]);
    if (is_left_out) return;
    by_ray_.push_back(zigzag(values_[i] - predicted_by_ray(i, left, up, corner, prediction)));
  });
  const bool by_ray = may_use_rays && estimated_bits(by_ray_) < estimated_bits(by_left_);
  add_planes(by_ray ? by_ray_ : by_left_);
  return by_ray;
}

PointCoding PointPlanes::split(std::span<const std::byte> records, std::uint64_t first) {
  begin(records.size() / record_.bytes(), first);
  PointCoding coding;
  find_missing(records, coding);
  bytes_.clear();
  bytes_.reserve(points_ * record_.bytes());  // the planes refer to it
  planes_.clear();
  planes_.push_back(std::as_bytes(std::span(mask_)));
  for (std::size_t place = 0; place < record_.words; ++place) {
    const std::size_t word = word_in_order(place);
    const bool is_x = word == record_.xyz[0];
    const bool is_y = word == record_.xyz[1];
    const bool by_ray = split_word(records, word, is_x || is_y);
    if (place == 0) keep_depth();
    if (by_ray) coding.rays = static_cast<std::uint8_t>(coding.rays | (is_x ? 1U : 2U));
  }
  return coding;
}

// ---- and back ------------------------------------------------------------------------------------------------------

void PointPlanes::join_word(std::size_t word, bool by_ray, std::span<const std::byte> planes, std::uint32_t missing,
                            std::span<std::byte> records) {
  const std::size_t count = planes.size() / 4;
  const auto* bytes = static_cast<const std::uint8_t*>(static_cast<const void*>(planes.data()));
  const bool may_be_missing = missing_count_ > 0 && is_coordinate(word);
  std::byte* out = records.data() + 4 * word;
  std::size_t next = 0;
  walk([&](std::size_t i, bool left, bool up, bool corner) {
    std::uint32_t prediction = predicted(i, left, up);
    const bool is_left_out = may_be_missing && is_missing(i);
    if (is_left_out) {
      values_[i] = prediction;
    } else {
      if (by_ray) prediction = predicted_by_ray(i, left, up, corner, prediction);
      const std::uint32_t residual = bytes[next] | std::uint32_t{bytes[count + next]} << 8U |
                                     std::uint32_t{bytes[2 * count + next]} << 16U |
                                     std::uint32_t{bytes[3 * count + next]} << 24U;
      ++next;
      values_[i] = prediction + from_zigzag(residual);
    }
    if (by_ray) ratio_[i] = ratio_of(values_[i], depth_[i]);
    const std::uint32_t bits = is_left_out ? missing : bits_of(values_[i]);
    std::memcpy(out + i * record_.bytes(), &bits, sizeof bits);
  });
}

bool PointPlanes::join(PointCoding coding, std::span<const std::byte> planes, std::uint64_t first,
                       std::span<std::byte> records) {
  begin(records.size() / record_.bytes(), first);
  if (coding.missing >= kMissingWords.size() || coding.rays > 3 || planes.size() < mask_.size()) return false;
  std::memcpy(mask_.data(), planes.data(), mask_.size());
  for (std::size_t i = 0; i < points_; ++i) missing_count_ += is_missing(i) ? 1U : 0U;
  const std::size_t there = points_ - missing_count_;
  if (planes.size() != mask_.size() + 4 * (3 * there + (record_.words - 3U) * points_)) return false;
  std::size_t at = mask_.size();
  for (std::size_t place = 0; place < record_.words; ++place) {
    const std::size_t word = word_in_order(place);
    const std::size_t bytes = 4 * (is_coordinate(word) ? there : points_);
    const bool by_ray =
        (word == record_.xyz[0] && (coding.rays & 1U) != 0) || (word == record_.xyz[1] && (coding.rays & 2U) != 0);
    join_word(word, by_ray, planes.subspan(at, bytes), kMissingWords[coding.missing], records);
    if (place == 0) keep_depth();
    at += bytes;
  }
  return true;
}

}  // namespace slabd::hal
