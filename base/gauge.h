// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "base/fixed.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/result.h"
#include "base/units.h"

/// Gauges measure the slab's dimensions that no scan of a block shows: length, width, thickness, bottom. A gauge is a
/// named channel with one number. The recipe makes an item of some of them by a formula from a closed list.
///
/// A number counts for a slab only if it belongs to that slab, is not too old, is plausible, and if the gauge was
/// checked with its master in time. All other numbers are kept with their state, and the items that need them are not
/// measured (reason 114).
namespace slabd {

using GaugeName = FixedString<limits::kGaugeNameBytes>;
using GaugeSource = FixedString<limits::kGaugeSourceBytes>;
/// A source with all settings that change its number, such as "modbus:10.0.0.5:502/1/120 f32 x0.001".
using GaugeChannel = FixedString<limits::kGaugeSourceBytes + 48>;

/// Carrier of a gauge's value.
enum class GaugeLink : std::uint8_t {
  plc,     ///< two of HR 40..71, by the PLC or a gauge hub
  modbus,  ///< a register of an instrument, which slabd reads
  udp,     ///< datagrams of a gauge hub
  manual,  ///< a person enters it (slabctl gauge enter)
};
inline constexpr std::array<std::string_view, 4> kGaugeLinks = {"plc", "modbus", "udp", "operator"};

/// Number in the registers of a Modbus instrument.
enum class GaugeFormat : std::uint8_t { i16, u16, i32, u32, f32 };
inline constexpr std::array<std::string_view, 5> kGaugeFormats = {"i16", "u16", "i32", "u32", "f32"};
[[nodiscard]] constexpr std::uint16_t registers_of(GaugeFormat format) {
  return format == GaugeFormat::i16 || format == GaugeFormat::u16 ? 1 : 2;
}

/// Master of a gauge: a piece of known size, measured in its place at regular times.
struct GaugeMaster {
  bool given = false;
  double value = kNoValue;    ///< certified, in the gauge's unit
  double u = kNoValue;        ///< its standard uncertainty (k = 1)
  double limit = kNoValue;    ///< largest deviation of a check that passes
  std::int64_t every_us = 0;  ///< a check is due this long after the last one
};

/// One [[gauge]] of the configuration.
struct GaugeSettings {
  GaugeName name;
  ItemUnit unit = ItemUnit::mm;
  GaugeSource source;    ///< as written: "plc:40", "modbus:10.0.0.5:502/1/120"
  GaugeChannel channel;  ///< a check counts only for the channel that it was made with
  GaugeLink link = GaugeLink::manual;
  std::uint8_t plc_index = 0;   ///< plc: 0..15, at HR 40 + 2 * plc_index
  FixedString<64> host;         ///< modbus: IPv4 address
  std::uint16_t port = 0;       ///< modbus, udp
  std::uint8_t unit_id = 1;     ///< modbus
  std::uint16_t address = 0;    ///< modbus: of the first register, from 0
  bool input_register = false;  ///< modbus: read with FC 4 instead of FC 3
  bool low_word_first = false;  ///< modbus: order of the two registers of a number
  GaugeFormat format = GaugeFormat::i32;
  double scale = 1.0;   ///< value = scale * number; a number of the PLC is in thousandths of the unit
  double u = kNoValue;  ///< standard uncertainty (k = 1) of one value, in the unit
  /// Measuring range of the sensor in its place; a value outside does not count.
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
  std::int64_t valid_ns = 0;  ///< a value older than this at SLAB_END is not used
  GaugeMaster master;

  [[nodiscard]] bool has_range() const { return low > -std::numeric_limits<double>::infinity(); }
};
using GaugeList = FixedVector<GaugeSettings, limits::kGaugesMax>;
/// No gauges. GCC 12 crashes if the constructor is first needed in a default argument.
inline constexpr GaugeList kNoGauges{};

/// The newest number of a gauge.
struct GaugeSample {
  bool has_value = false;
  double value = kNoValue;    ///< in the unit, scaled
  std::uint32_t seq = 0;      ///< of the sender; of an instrument or a person: counts its values
  std::uint32_t slab_no = 0;  ///< slab that it names; 0: none
  std::int64_t mono_ns = 0;   ///< when it arrived
  std::int64_t utime_us = 0;
};
using GaugeSamples = std::array<GaugeSample, limits::kGaugesMax>;  ///< [index in the GaugeList]

/// Result of one master check.
struct GaugeCheck {
  GaugeName gauge;
  ItemUnit unit = ItemUnit::mm;
  double value = kNoValue;  ///< as the gauge read the master
  double master_value = kNoValue;
  double master_u = kNoValue;
  double within = kNoValue;   ///< largest deviation that passes
  bool passed = false;        ///< |value - master_value| <= within
  std::int64_t utime_us = 0;  ///< 0: there was none
  GaugeChannel source;        ///< GaugeSettings::channel
};

/// True if the check with this master passed.
[[nodiscard]] bool passes(const GaugeCheck& check);

/// Usability of a value for its slab: the first of these that applies.
enum class GaugeState : std::uint8_t {
  ok,
  missing,        ///< no value, or none since the start of slabd
  other_slab,     ///< names another slab, was used for another slab, or names none (see bind())
  stale,          ///< older than valid_s
  out_of_range,   ///< outside the gauge's measuring range
  not_plausible,  ///< far from the item's nominal: another unit, another dimension
  unchecked,      ///< never checked with the configured master and source
  check_failed,   ///< the last check was outside its limit
  check_overdue,  ///< the last check is older than every_h
};
inline constexpr std::size_t kGaugeStates = 9;
[[nodiscard]] std::string_view name(GaugeState state);
/// The state of this name; `missing` for others.
[[nodiscard]] GaugeState gauge_state_of(std::string_view name);
/// Reason in words, to follow "length_left:"; empty for ok.
[[nodiscard]] std::string_view reason_of(GaugeState state);

/// Value of one gauge as it counted for a slab; stored with it.
struct GaugeReading {
  GaugeName gauge;
  GaugeSource source;
  ItemUnit unit = ItemUnit::mm;
  GaugeState state = GaugeState::missing;
  double value = kNoValue;  ///< also kept if it is not usable; NaN: there was none
  double u = kNoValue;      ///< standard uncertainty (k = 1) of the gauge
  double u_master = 0.0;    ///< standard uncertainty (k = 1) by its master: see master_uncertainty()
  std::uint32_t seq = 0;
  std::uint32_t slab_no = 0;
  std::int64_t utime_us = 0;        ///< arrival; 0: no value
  double age_s = kNoValue;          ///< at SLAB_END
  std::int64_t check_utime_us = 0;  ///< the master check in force; 0: none
  double check_deviation = kNoValue;
};
using GaugeReadings = FixedVector<GaugeReading, limits::kGaugesMax>;
/// No readings; see kNoGauges.
inline constexpr GaugeReadings kNoGaugeReadings{};

/// Standard uncertainty (k = 1) that the master leaves: its own, and its check's limit as half width of a rectangular
/// distribution, because a gauge that is off by less passes: u^2 = u_master^2 + limit^2 / 3. 0 without a master.
[[nodiscard]] double master_uncertainty(const GaugeMaster& master);

/// True if the value is that of a master: all but an instrument name the slab that a value belongs to, and a master has
/// none.
[[nodiscard]] bool is_of_master(const GaugeSettings& gauge, const GaugeSample& sample);

/// Usability of a gauge's master check at this time. A check that is more than an hour ahead was made with a wrong
/// clock and does not count.
[[nodiscard]] GaugeState check_state(const GaugeSettings& gauge, const GaugeCheck& last, std::int64_t utime_us);

/// The slab to which values are bound at its SLAB_END.
struct GaugeMoment {
  std::uint32_t slab_no = 0;
  std::int64_t begin_ns = 0;  ///< SLAB_BEGIN, monotonic; a slab that was open at a restart begins with the process
  std::int64_t end_ns = 0;    ///< SLAB_END
  std::int64_t utime_us = 0;  ///< SLAB_END, for the due date of checks: the wall clock, or the newest record if later
};

/// Binds the newest sample of a gauge to a slab. It belongs to the slab if it names its number. A sample without a
/// number belongs to it if it arrived after SLAB_BEGIN and cannot be a master's (is_of_master()), or if the slab has no
/// number either. `used`: the reading of the slab before, or nullptr; a sample with its slab number and sequence number
/// was used for that slab and does not count again.
[[nodiscard]] GaugeReading bind(const GaugeSettings& gauge, const GaugeSample& sample, const GaugeCheck& last_check,
                                const GaugeReading* used, const GaugeMoment& slab);

/// Number of slabs in a row for which each gauge gave the same value, over restarts.
struct GaugeRun {
  GaugeName gauge;
  double value = kNoValue;
  int slabs = 0;
  [[nodiscard]] bool is_stuck() const { return slabs >= limits::kGaugeStuckSlabs; }
};
using GaugeRuns = FixedVector<GaugeRun, limits::kGaugesMax>;
/// Adds the values of a slab that has ended. A slab without a value of the gauge does not count.
void add_slab(GaugeRuns& runs, const GaugeReadings& readings);

// ---- formulas ----------------------------------------------------------------------------------------------------

/// Forms of a formula. The list is closed: no expressions.
enum class FormulaKind : std::uint8_t {
  none,             ///< the item has no formula
  mean,             ///< of all gauges
  difference,       ///< the first minus the second
  range,            ///< the largest minus the smallest
  plane4_flatness,  ///< of four heights at the corners of a rectangle, in order around it
};
struct FormulaInfo {
  FormulaKind kind;
  std::string_view name;
  std::size_t gauges_min;
  std::size_t gauges_max;
};
/// All forms except `none`.
[[nodiscard]] std::span<const FormulaInfo> formula_infos();
[[nodiscard]] const FormulaInfo& info(FormulaKind kind);

struct GaugeFormula {
  FormulaKind kind = FormulaKind::none;
  FixedVector<GaugeName, limits::kFormulaGaugesMax> gauges;
  std::uint32_t line = 0;  ///< in the recipe's file

  [[nodiscard]] bool given() const { return kind != FormulaKind::none; }
};

/// Longest text of a formula: its name, eight gauges, commas.
using FormulaText = FixedString<limits::kFormulaGaugesMax*(limits::kGaugeNameBytes + 2) + 24>;
/// "mean(length_left, length_right)".
[[nodiscard]] FormulaText text_of(const GaugeFormula& formula);
/// Parses such a text. config: the text names the fault and what is allowed: form, number of gauges, their names, a
/// gauge named twice.
[[nodiscard]] Result<GaugeFormula> parse_formula(std::string_view text);
/// True for a name of a gauge: lower-case letters, digits and '_', a letter first.
[[nodiscard]] bool is_gauge_name(std::string_view name);

/// Items that gauges measure, in the order of ItemId.
inline constexpr std::size_t kGaugeItems = 4;
inline constexpr std::array<ItemId, kGaugeItems> kGaugeItemIds = {ItemId::slab_length, ItemId::slab_width,
                                                                  ItemId::slab_thickness, ItemId::bottom_flatness};
[[nodiscard]] constexpr std::size_t gauge_item_index(ItemId id) {
  return static_cast<std::size_t>(id) - static_cast<std::size_t>(ItemId::slab_length);
}

/// Value of a formula, with its standard uncertainties (k = 1).
struct FormulaValue {
  double value = kNoValue;  ///< NaN unless every gauge has a usable value
  double u_gauge = 0.0;     ///< gauges are independent: root sum of squares of sensitivity * u
  /// By the masters: sum of |sensitivity| * u_master, which is right for any correlation, as gauges may share a master.
  double u_master = 0.0;
};
/// Sensitivities: mean 1/n each; difference 1 and -1; range 1 of the largest and -1 of the smallest; plane4_flatness
/// 1/2 each. plane4_flatness is |a - b + c - d| / 2, the least distance of two parallel planes that hold the four
/// points (ISO 12781 minimum zone), as the two diagonals of a rectangle lie in such planes.
[[nodiscard]] FormulaValue evaluate(const GaugeFormula& formula, const GaugeReadings& readings);

/// The reading of a gauge; nullptr if there is none.
[[nodiscard]] const GaugeReading* find_gauge(const GaugeReadings& readings, std::string_view gauge);

}  // namespace slabd
