// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/base.h"

/// All words of the report in every language. Numbers, ids and units are the same in all languages.
namespace slabd::report {

enum class Language : std::uint8_t { en, zh };
/// HTML lang attribute: "en", "zh".
[[nodiscard]] std::string_view code(Language language);

enum class Word : std::uint8_t {
  title,
  overview,
  findings,
  no_findings,
  no_findings_but,
  more_findings,
  warnings,
  identity,
  block,
  blocks,
  slab_items,
  seats,
  full_and_crop,
  registration_table,
  cycle_times,
  characteristic,
  unit,
  nominal,
  limits,
  measured,
  deviation,
  uncertainty,
  verdict,
  information,
  map_title,
  map_alt,
  row_positive,
  row_negative,
  registration_map,
  seat_map,
  tolerance_chart,
  flatness,
  standard_deviation,
  chart_title,
  points,
  mean,
  crop,
  full_plane,
  normal,
  normal_to_top,
  inliers,
  attempts,
  settle,
  acquire,
  read,
  denoise,
  register_step,
  extract,
  total,
  evaluation_points,
  slab_id,
  slab_number,
  slab_type,
  database_key,
  began,
  ended,
  still_open,
  recipe,
  hand_eye,
  station_corrections,
  scanner_acceptance,
  scanner_not_verified,
  tie,
  budget,
  budget_note,
  budget_note_tie,
  block_column,
  budget_fit,
  budget_noise,
  budget_scanner,
  budget_registration,
  budget_calibration,
  budget_robot,
  budget_reference,
  budget_thermal,
  budget_gauge,
  budget_tie,
  software,
  acceptance,
  guarded,
  simple_acceptance,
  slab_fit,
  slab_fit_value,
  scan_file,
  scanned,
  none,
  not_scanned,
  not_measured_sentence,
  not_measured_yet,
  not_measured_aborted,
  aborted_block,
  aborted_note,
  no_map,
  unconfirmed,
  not_visible,
  gauges,
  gauge,
  gauge_source,
  gauge_state,
  gauge_check,
  commissioning,
  open_warning,
  outside_scale,
  scale_note,
  defect,
  standing_out,
  sunk,
  lower_end,
  upper_end,
  slab_word,
  temperature,
  design,
  disposition,
  unknown_temperature,
  no_slab_temperature,  ///< outside the temperatures of slabs
  corrected_lengths,
  uncorrected_lengths,
  as_measured,  ///< value of an item before its correction for temperature
  age,
  mould,
  key,
  value,
  page,
  flatness_note,
  pores,
  edges,
  refused,
};
[[nodiscard]] std::string_view word(Word word, Language language);
/// Text that is used in one place only.
[[nodiscard]] inline std::string pick(Language language, std::string_view en, std::string_view zh) {
  return std::string(language == Language::zh ? zh : en);
}

[[nodiscard]] std::string item_word(ItemId id, Language language);
/// Meaning and cure of an item's reason in Chinese, for items with ItemInfo::meaning; else empty.
struct ReasonWords {
  std::string_view meaning;
  std::string_view cure;
};
[[nodiscard]] ReasonWords item_reason_zh(ItemId id);
/// "ok", or why a gauge's value did not count.
[[nodiscard]] std::string gauge_state_sentence(GaugeState state, Language language);
[[nodiscard]] std::string_view verdict_word(Verdict verdict, Language language);
/// A finding with place and size.
[[nodiscard]] std::string finding_sentence(const SurfaceFinding& finding, Language language);
/// Kind and size: "chip 40 x 15".
[[nodiscard]] std::string finding_mark(const SurfaceFinding& finding, Language language);
/// Count, largest, deepest and share, with the limits of depth and share; empty if pores were not looked for.
[[nodiscard]] std::string pore_sentence(const PoreSummary& pores, Language language);
/// Planes and casings that were rejected, and the reason: "inner jaw: another plane holds about as many points; outer
/// casing: ..."; empty if none was.
[[nodiscard]] std::string refusal_sentence(const BlockResult& block, Language language);
/// "fillet 4.1 mm seat/jaw_inner, 4.3 mm seat/jaw_outer (nominal 4), chamfer 3.6..4.1 mm ends"; empty if no edge was
/// seen.
[[nodiscard]] std::string edge_sentence(const BlockResult& block, Language language);
/// Emulated parts by emulation bits: "EMULATED (robot emulated, scan emulated): no verdict on concrete"; empty for 0.
[[nodiscard]] std::string emulation_notice(std::uint8_t bits, Language language);
/// Emulation bit of a name in kEmulationNames; 0 for other names.
[[nodiscard]] unsigned emulation_bit(std::string_view name);
/// The same notice for a running line; `now` has the bits of the line without the slab that is shown.
[[nodiscard]] std::string emulation_banner(std::uint8_t shown, std::uint8_t now, Language language);
/// The notice in one word, for tables and watermarks; empty for 0.
[[nodiscard]] std::string_view emulation_mark(std::uint8_t bits, Language language);
/// "seat slope", or "402: no supporting block was found, ..."; empty for 0.
[[nodiscard]] std::string reason_sentence(std::uint16_t reason, Language language);

// ---- code_words.cpp ----------------------------------------------------------------------------------------------

/// describe() and cure() of a code in either language.
[[nodiscard]] std::string_view meaning(Code code, Language language);
[[nodiscard]] std::string_view cure_words(Code code, Language language);
/// A WARN bit in Chinese; empty if unknown here (the daemon has the English text).
[[nodiscard]] std::string_view warning_zh(std::uint16_t bit);
/// Text of STATE as named in slabd.status/1.
[[nodiscard]] std::string_view state_word(std::string_view state, Language language);

}  // namespace slabd::report
