// SPDX-License-Identifier: Apache-2.0
//
// Composes the report of a stored slab. The first two pages are the whole answer: verdict, map, findings, basis of the
// measurement, notes, signatures. The evidence of the blocks with findings follows, with `full` that of all blocks.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "report/content.h"
#include "report/figures.h"
#include "report/findings.h"
#include "report/json.h"
#include "report/retell.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

/// More findings would push the identities off the first page.
constexpr std::size_t kFindingsShown = 22;

class Composer {
 public:
  Composer(const SlabPicture& picture, const Choice& choice)
      : picture_(picture),
        record_(*picture.record),
        header_(record_.summary.header),
        language_(choice.language),
        full_(choice.full),
        project_(choice.project) {}

  Report compose() {
    Report report;
    report.language = language_;
    report.title = say(Word::title);
    report.subject = fmt::format("{} {} \"{}\"", say(Word::slab_word), header_.slab_no, header_.slab_id.view());
    report.open = is_open(record_);
    report.verdict = report.open ? Verdict::none : record_.summary.verdict;
    report.ended_utime_us = record_.summary.ended_utime_us;
    report.emulated = header_.emulated;
    findings_ = findings_of(record_, language_);
    report.sections.push_back(overview());
    report.sections.push_back(findings());
    report.sections.push_back(identity());
    report.sections.push_back(warnings());
    report.sections.push_back(signatures());
    report.sections.push_back(seats_chart());
    add_budget(report.sections);
    for (int station = 1; station <= header_.stations; ++station)
      if (full_ || (is_objected(findings_, station) && measured(station) != nullptr))
        report.sections.push_back(block(station));
    if (full_ || hides_finding_of_slab()) report.sections.push_back(slab_items());
    if (!full_) return report;
    if (!record_.slab.gauges.empty()) report.sections.push_back(gauges());
    report.sections.push_back(seats());
    report.sections.push_back(registration());
    report.sections.push_back(times());
    return report;
  }

 private:
  [[nodiscard]] std::string say(Word which) const { return std::string(word(which, language_)); }
  template <typename... Args>
  [[nodiscard]] std::string say(Word which, const Args&... args) const {
    return fmt::format(fmt::runtime(word(which, language_)), args...);
  }
  /// The measured block of a station, or nullptr.
  [[nodiscard]] const SlabBlock* measured(int station) const {
    const SlabBlock* block = latest(record_, station);
    return block != nullptr && block->phase == StationPhase::measured ? block : nullptr;
  }
  [[nodiscard]] std::string times_text(std::int64_t utime_us) const {
    return utime_us == 0 ? say(Word::none) : local_time(utime_us);
  }
  /// Label of an item; items of the slab name their stations.
  [[nodiscard]] std::string item_label(const Item& item, bool of_slab) const {
    std::string label = item_word(item.id, language_);
    if (!of_slab) return label;
    if (item.station_to != 0) return fmt::format("{} {}-{}", label, item.station, item.station_to);
    return item.station == 0 ? label : fmt::format("{} {}", label, item.station);
  }

  Section overview() {
    Section section;
    section.parts.push_back(Figures{{slab_map_figure(record_, language_)}});
    return section;
  }

  /// True if the item's block already reports it.
  [[nodiscard]] bool said_by_block(const Item& item) const {
    const SlabBlock* block = item.station_to == 0 && item.station != 0 ? measured(item.station) : nullptr;
    return block != nullptr && find_item(block->block.items.begin(), block->block.items.end(), item.id) != nullptr;
  }

  /// Reason for a station without a result if no code gives one.
  [[nodiscard]] std::string unmeasured_sentence(int station) const {
    const SlabBlock* block = latest(record_, station);
    if (block == nullptr || block->phase != StationPhase::acquired) return say(Word::not_scanned);
    return say(is_aborted(record_) ? Word::not_measured_aborted : Word::not_measured_yet);
  }

  /// Number of items that the recipe does not require and that were not measured.
  [[nodiscard]] int not_required_not_measured() const {
    const auto counts = [](const Item& item) {
      return item.verdict == Verdict::not_measured && !item.required ? 1 : 0;
    };
    int count = 0;
    for (int station = 1; station <= header_.stations; ++station)
      if (const SlabBlock* block = measured(station))
        for (const Item& item : block->block.items) count += counts(final_item(record_, station, item));
    for (const Item& item : record_.slab.items)
      if (!said_by_block(item)) count += counts(item);
    return count;
  }

  /// True if a finding of the slab, which is on no block's page, is beyond the first page.
  [[nodiscard]] bool hides_finding_of_slab() const {
    const auto hidden = findings_.begin() + static_cast<std::ptrdiff_t>(std::min(findings_.size(), kFindingsShown));
    return std::any_of(hidden, findings_.end(), [&](const Finding& finding) {
      if (!finding.stations.empty()) return false;
      if (!finding.item || finding.item->station == 0 || finding.item->station_to != 0) return true;
      const SlabBlock* block = measured(finding.item->station);  // its page has the slab's items of this station
      return block == nullptr || block->block.items.empty();
    });
  }

  Section findings() {
    Section section;
    section.title = say(Word::findings);
    for (std::size_t i = 0; i < std::min(findings_.size(), kFindingsShown); ++i)
      section.parts.push_back(Paragraph{sentence_of(findings_[i], language_), findings_[i].verdict});
    if (findings_.size() > kFindingsShown)
      section.parts.push_back(Paragraph{say(Word::more_findings, findings_.size() - kFindingsShown)});
    // The sentence that contains "pass" is printed only for a slab that passed, even if the list of findings is empty.
    const storage::SlabSummary& summary = record_.summary;
    const int open_items = not_required_not_measured();
    if (findings_.empty() && !is_open(record_) && summary.verdict == Verdict::pass)
      section.parts.push_back(
          Paragraph{open_items == 0 ? say(Word::no_findings) : say(Word::no_findings_but, open_items), Verdict::pass});
    else if (findings_.empty() && !is_open(record_))
      section.parts.push_back(Paragraph{reason_sentence(summary.reason, language_), summary.verdict});
    return section;
  }

  /// Lines for the decision of people and their names.
  Section signatures() {
    Section section;
    section.together = true;
    section.parts.push_back(Figures{{signature_figure(!is_open(record_) && record_.summary.verdict != Verdict::pass,
                                                      header_.slab_id.view(), language_)}});
    return section;
  }

  /// A calibration with its date, its validity and the first line of its certificate.
  [[nodiscard]] std::string traced(const std::string& id) const {
    std::string text = id;
    for (const storage::CalibrationRecord& calibration : picture_.calibrations) {
      if (calibration.id != id) continue;
      text += fmt::format(", {}", local_time(calibration.created_utime_us));
      if (!calibration.operator_name.empty()) text += ", " + calibration.operator_name;
      if (calibration.expires_utime_us != 0)
        text += fmt::format(", {} {}", pick(language_, "valid until", "有效期至"),
                            local_time(calibration.expires_utime_us));
      const std::string first = calibration.certificate.substr(0, calibration.certificate.find('\n'));
      if (!first.empty()) text += fmt::format(", {} {:.60}", pick(language_, "certificate", "证书"), first);
      break;
    }
    return text;
  }

  Section warnings() {
    Section section;
    section.title = say(Word::warnings);
    const auto add = [&](std::string text) {
      Paragraph paragraph{std::move(text)};
      paragraph.warning = true;
      section.parts.push_back(std::move(paragraph));
    };
    if (header_.emulated != 0) add(emulation_notice(header_.emulated, language_));
    if (is_open(record_)) add(say(Word::open_warning));
    if (is_aborted(record_)) add(say(Word::aborted_note));
    if (header_.unconfirmed > 0) add(say(Word::unconfirmed, header_.unconfirmed));
    bool commissioning = header_.calibration_id.empty();
    for (int station = 1; station <= header_.stations; ++station)
      if (const SlabBlock* block = measured(station))
        commissioning = commissioning || block->attempt.splice.source == SpliceSource::commissioning;
    if (commissioning) add(say(Word::commissioning));
    const bool all_verified =
        !header_.scanner_id.empty() && std::none_of(header_.more_arms.begin(), header_.more_arms.end(),
                                                    [](const SlabArm& arm) { return arm.scanner_id.empty(); });
    if (!all_verified) add(say(Word::scanner_not_verified));
    if (header_.guard == 0.0) add(say(Word::simple_acceptance));
    const SlabFitReport& fit = record_.slab.fit;
    if (fit.ok && !fit.note.empty()) add(fmt::format("{}: {}", say(Word::slab_fit), fit_note()));
    for (const GaugeReading& reading : record_.slab.gauges)
      if (reading.state != GaugeState::ok)
        add(fmt::format("{} {}: {}", say(Word::gauge), reading.gauge.view(),
                        gauge_state_sentence(reading.state, language_)));
    if (const std::string unseen = unseen_dimensions(record_.slab, language_); !unseen.empty())
      add(say(Word::not_visible, unseen));
    return section;
  }

  [[nodiscard]] std::string fit_note() const {
    const std::string_view note = record_.slab.fit.note.view();
    return language_ == Language::zh ? retold_or_quoted(note) : std::string(note);
  }

  Section identity() {
    Section section;
    section.title = say(Word::identity);
    section.together = true;
    Table table;
    table.title = say(Word::identity);
    table.columns = {say(Word::key) + "<", say(Word::value) + "<"};
    const auto add = [&](Word key, std::string value) { table.add(say(key), value.empty() ? say(Word::none) : value); };
    if (!project_.empty()) table.add(pick(language_, "project", "项目"), project_);
    add(Word::slab_id, std::string(header_.slab_id.view()));
    add(Word::slab_number, fmt::format("{}, {} {}, {} {}", header_.slab_no, say(Word::slab_type), header_.slab_type,
                                       say(Word::database_key), header_.key));
    add(Word::began, times_text(header_.began_utime_us));
    add(Word::ended, is_open(record_) ? say(Word::still_open) : times_text(record_.summary.ended_utime_us));
    if (header_.temperature_dk != 0 || is_at_reference(record_)) add(Word::temperature, temperature_text());
    if (header_.age_h != 0) add(Word::age, fmt::format("{} h", header_.age_h));
    if (header_.mould != 0) add(Word::mould, fmt::format("{}", header_.mould));
    add(Word::recipe, fmt::format("{}, {}", header_.recipe.view(), header_.recipe_sha256.view()));
    for (const storage::DispositionRecord& d : record_.dispositions)
      add(Word::disposition, disposition_sentence(d, language_));
    if (!header_.design_sha256.empty()) add(Word::design, std::string(header_.design_sha256.view()));
    add(Word::hand_eye, traced(std::string(header_.calibration_id.view())));
    add(Word::station_corrections, traced(std::string(header_.stations_id.view())));
    add(Word::scanner_acceptance, traced(std::string(header_.scanner_id.view())));
    for (const SlabArm& arm : header_.more_arms) {
      const auto of_arm = [&](Word key, const CalibrationId& id) {
        table.add(fmt::format("{} {}", say(key), arm.by.scanner.view()),
                  id.empty() ? say(Word::none) : traced(std::string(id.view())));
      };
      of_arm(Word::hand_eye, arm.calibration_id);
      of_arm(Word::station_corrections, arm.stations_id);
      of_arm(Word::scanner_acceptance, arm.scanner_id);
    }
    if (!header_.more_arms.empty()) add(Word::tie, traced(std::string(header_.tie_id.view())));
    add(Word::acceptance, header_.guard == 0.0       ? say(Word::simple_acceptance)
                          : has_value(header_.guard) ? say(Word::guarded, figure(header_.guard, 2))
                                                     : std::string());
    const SlabFitReport& fit = record_.slab.fit;
    if (fit.ok)
      add(Word::slab_fit, say(Word::slab_fit_value, fit.seats, figure(fit.rms_mm, 3)));
    else if (!is_open(record_))
      add(Word::slab_fit,
          fmt::format("{}: {}", verdict_word(Verdict::not_measured, language_),
                      is_aborted(record_) ? reason_sentence(record_.summary.reason, language_) : fit_note()));
    add(Word::software, std::string(header_.software.view()));
    section.parts.push_back(std::move(table));
    return section;
  }

  [[nodiscard]] Table item_table(std::string caption) const {
    Table table;
    table.title = std::move(caption);
    table.columns = {say(Word::characteristic) + "<",
                     say(Word::unit) + "<",
                     say(Word::nominal),
                     say(Word::limits),
                     say(Word::measured),
                     say(Word::deviation),
                     say(Word::uncertainty),
                     say(Word::verdict) + "<"};
    return table;
  }
  /// The slab's temperature, and whether lengths are those at the recipe's reference temperature.
  std::string temperature_text() const {
    const double temperature_c = slab_temperature_c(header_.temperature_dk);
    std::string text = has_value(temperature_c) ? fmt::format("{:.1f} °C", temperature_c)
                       : header_.temperature_dk != 0
                           ? fmt::format("{:.1f} K, {}", 0.1 * header_.temperature_dk, say(Word::no_slab_temperature))
                           : say(Word::unknown_temperature);
    if (is_at_reference(record_))
      text += "; " + say(has_value(temperature_c) ? Word::corrected_lengths : Word::uncorrected_lengths);
    return text;
  }

  void add_item(Table& table, const Item& item, bool of_slab) const {
    const std::string limits = limits_figure(item);
    table.add(item_label(item, of_slab), name(info(item.id).unit), nominal_figure(item),
              limits.empty() ? say(Word::information) : limits, value_figure(item), deviation_figure(item),
              U_figure(item),
              Cell(item.verdict, item.verdict == Verdict::none ? "" : verdict_word(item.verdict, language_)));
    if (is_corrected(item)) table.add("  " + say(Word::as_measured), "", "", "", Cell(item.measured, 3), "", "", "");
  }

  Section slab_items() {
    Section section;
    section.title = say(Word::slab_items);
    if (record_.slab.items.empty()) {
      section.parts.push_back(Paragraph{is_open(record_) ? say(Word::open_warning)
                                        : is_aborted(record_)
                                            ? say(Word::aborted_note)
                                            : fmt::format("{}: {}", verdict_word(record_.summary.verdict, language_),
                                                          verdict_word(Verdict::not_measured, language_))});
      return section;
    }
    Table table = item_table(section.title);
    for (const Item& item : record_.slab.items) add_item(table, item, true);
    section.parts.push_back(std::move(table));
    return section;
  }

  Section gauges() {
    Section section;
    section.title = say(Word::gauges);
    section.together = true;
    Table table;
    table.title = section.title;
    table.columns = {say(Word::gauge) + "<", say(Word::gauge_source) + "<", say(Word::unit) + "<",
                     say(Word::measured),    say(Word::gauge_state) + "<",  say(Word::gauge_check)};
    for (const GaugeReading& reading : record_.slab.gauges)
      table.add(reading.gauge.view(), reading.source.view(), name(reading.unit), Cell(reading.value, 3),
                gauge_state_sentence(reading.state, language_), Cell(reading.check_deviation, 3));
    section.parts.push_back(std::move(table));
    return section;
  }

  Section seats_chart() {
    Section section;
    section.together = true;
    section.filler = !full_;
    section.parts.push_back(Figures{{seats_figure(record_, language_)}});
    return section;
  }

  Section seats() {
    Section section;
    section.title = say(Word::seats);
    Table table;
    table.title = say(Word::full_and_crop);
    table.columns = {say(Word::block, "") + "<",
                     say(Word::full_plane) + ": " + say(Word::normal),
                     say(Word::points),
                     "std, mm",
                     say(Word::crop) + ": " + say(Word::normal),
                     say(Word::points),
                     "std, mm"};
    for (int station = 1; station <= header_.stations; ++station) {
      const SlabBlock* block = measured(station);
      if (block == nullptr) continue;
      const auto normal = [](const Vec3& n) {
        return fmt::format("({}, {}, {})", figure(n.x(), 5), figure(n.y(), 5), figure(n.z(), 5));
      };
      const PlaneFit& full = block->block.seat.full_plane;
      const PlaneFit& crop = block->block.seat.plane;
      table.add(station);
      for (const PlaneFit* plane : {&full, &crop})
        for (const Cell& cell : plane->ok ? Table::Row{normal(plane->normal), plane->inliers, Cell(plane->std_mm, 4)}
                                          : Table::Row{"-", "-", "-"})
          table.rows.back().push_back(cell);
    }
    section.parts.push_back(std::move(table));
    return section;
  }

  Section registration() {
    Section section;
    section.title = say(Word::registration_table);
    Table table;
    table.title = section.title;
    table.columns = {say(Word::block, "") + "<", say(Word::points), say(Word::mean) + ", mm", "std, mm"};
    Table counts = table;  // the same table with numbers of points
    counts.title = say(Word::points);
    for (int sigma = 1; sigma <= 6; ++sigma) {
      table.columns.emplace_back(fmt::format("±{}σ, %", sigma));
      counts.columns.emplace_back(fmt::format("±{}σ", sigma));
    }
    for (int station = 1; station <= header_.stations; ++station) {
      const SlabBlock* block = measured(station);
      if (block == nullptr) continue;
      // Deviations from the model are meaningless if the block was not found in the scan.
      if (block->block.registration.status != RegistrationStatus::converged) continue;
      const DeviationStats& deviation = block->block.registration.deviation;
      table.add(station, deviation.count, Cell(deviation.mean_mm, 4), Cell(deviation.std_mm, 4));
      counts.rows.push_back(table.rows.back());
      for (const double share : deviation.within_sigma) {
        table.rows.back().emplace_back(100.0 * share, 3);
        counts.rows.back().emplace_back(std::llround(share * static_cast<double>(deviation.count)));
      }
    }
    section.parts.push_back(std::move(table));
    section.parts.push_back(std::move(counts));
    return section;
  }

  void add_budget(std::vector<Section>& sections) const {
    std::optional<Table> table = budget_table(record_, language_);
    if (!table) return;
    Section section;
    section.title = table->title;
    section.together = true;
    section.filler = !full_;
    const auto named = [&](const CalibrationId& id) { return id.empty() ? say(Word::none) : std::string(id.view()); };
    std::string ids = named(header_.scanner_id);
    for (const SlabArm& arm : header_.more_arms) ids += ", " + named(arm.scanner_id);
    section.parts.push_back(Paragraph{say(Word::budget_note, ids)});
    if (!header_.tie_id.empty()) section.parts.push_back(Paragraph{say(Word::budget_note_tie)});
    section.parts.push_back(std::move(*table));
    sections.push_back(std::move(section));
  }

  /// Robot and scanner of a scan; empty on a line with one.
  [[nodiscard]] std::string arm_words(const SlabBlock& block) const {
    if (header_.more_arms.empty()) return {};
    const Arm& by = block.attempt.by;
    return fmt::format(fmt::runtime(pick(language_, "robot {}, scanner {}", "机器人 {}，扫描仪 {}")), by.robot.view(),
                       by.scanner.view());
  }

  Section times() {
    Section section;
    section.title = say(Word::cycle_times);
    Table table;
    table.title = section.title;
    table.columns = {
        say(Word::block, "") + "<", say(Word::scanned) + "<", say(Word::attempts), say(Word::settle),
        say(Word::acquire),         say(Word::read),          say(Word::denoise),  say(Word::register_step),
        say(Word::extract),         say(Word::total)};
    const bool several = !header_.more_arms.empty();
    if (several) table.columns.emplace_back(std::string(pick(language_, "by", "设备")) + "<");
    for (int station = 1; station <= header_.stations; ++station) {
      const SlabBlock* block = latest(record_, station);
      if (block == nullptr) continue;
      const StageTimes& times = block->block.times;
      table.add(station, times_text(block->attempt.scan_utime_us), block->attempt.number,
                Cell(1e-3 * block->attempt.settle_ms, 2), Cell(1e-3 * block->attempt.acquire_ms, 2));
      for (const double ms : {times.read_ms, times.denoise_ms, times.register_ms, times.extract_ms, times.total_ms})
        table.rows.back().emplace_back(block->phase == StationPhase::measured ? ms : kNoValue, 0);
      if (several) table.rows.back().emplace_back(arm_words(*block));
    }
    section.parts.push_back(std::move(table));
    return section;
  }

  /// The paper's Table 5 begins with the seat's normal; its nominal follows from the nominal slope. The normal is
  /// relative to the slab top beside the seat, even if the slope below is judged against the slab's frame.
  void add_normal(Table& table, const BlockResult& block) const {
    const Item* slope = find_item(block.items.begin(), block.items.end(), ItemId::seat_slope);
    const double tilt = slope != nullptr && has_value(slope->nominal) ? rad_from_deg(slope->nominal) : kNoValue;
    const Vec3 nominal(0.0, -std::sin(tilt), std::cos(tilt));
    static constexpr std::array<const char*, 3> kNames = {"I", "J", "K"};
    for (int i = 0; i < 3; ++i) {
      const double value = block.seat.normal_datum.isZero() ? kNoValue : block.seat.normal_datum[i];
      table.add(say(Word::normal_to_top, kNames.at(static_cast<std::size_t>(i))), "-",
                Cell(has_value(tilt) ? nominal[i] : kNoValue, 6), say(Word::information), Cell(value, 6),
                Cell(has_value(tilt) ? value - nominal[i] : kNoValue, 6), "-", "");
    }
  }

  Section block(int station) {
    Section section;
    section.together = true;
    const auto [verdict, reason] = shown(record_, station);
    section.title = say(Word::block, station);
    section.verdict = verdict;
    section.remark = reason_sentence(reason, language_);
    const SlabBlock* block = latest(record_, station);
    if (is_aborted(record_) && verdict == Verdict::none && measured(station) != nullptr)
      section.remark = say(Word::aborted_block);
    if (block == nullptr) {
      section.parts.push_back(Paragraph{say(Word::not_scanned)});
      return section;
    }
    std::string about = fmt::format("{} {} · {} {}", say(Word::scanned), times_text(block->attempt.scan_utime_us),
                                    say(Word::scan_file), block->attempt.scan_path.view());
    if (const std::string arm = arm_words(*block); !arm.empty()) about += " · " + arm;
    const SeatFeature& seat = block->block.seat;
    if (block->phase == StationPhase::measured && has_value(seat.flatness_mm))
      about += fmt::format(" · {} {}", seat.grid_points, say(Word::evaluation_points));
    if (block->phase == StationPhase::measured && has_value(seat.flatness_noise_mm))
      about += " · " + say(Word::flatness_note, figure(seat.flatness_noise_mm, 3));
    section.parts.push_back(Paragraph{std::move(about)});
    if (block->phase != StationPhase::measured || block->block.items.empty()) {
      section.parts.push_back(Paragraph{
          block->phase == StationPhase::acquired
              ? unmeasured_sentence(station)
              : fmt::format("{}: {}", say(Word::not_measured_sentence), reason_sentence(block->code, language_))});
      return section;
    }
    const BlockResult& result = block->block;
    Table table = item_table(fmt::format("{}: {}", section.title, say(Word::characteristic)));
    add_normal(table, result);
    // Results of SLAB_END for the block: slope against the slab's frame, and position of the seat among the others.
    std::vector<Item> items;
    for (const Item& item : result.items) items.push_back(final_item(record_, station, item));
    for (const Item& item : record_.slab.items)
      if (item.station == station && item.station_to == 0 && !said_by_block(item)) items.push_back(item);
    for (const Item& item : items) add_item(table, item, false);
    section.parts.push_back(std::move(table));
    const SurfaceDefect& defect = result.seat.defect;
    if (defect.cells > 0) {
      Paragraph paragraph{say(Word::defect, figure(defect.area_mm2, 1),
                              say(defect.height_mm > 0.0 ? Word::standing_out : Word::sunk),
                              figure(std::abs(defect.height_mm), 3), figure(defect.x_mm, 1), figure(defect.s_mm, 1))};
      paragraph.warning = true;
      section.parts.push_back(std::move(paragraph));
    }
    if (const std::string refused = refusal_sentence(result, language_); !refused.empty())
      section.parts.push_back(Paragraph{say(Word::refused, refused)});
    // One paragraph, because two blocks must fit on a page.
    std::string surface;
    if (const std::string pores = pore_sentence(result.pores, language_); !pores.empty())
      surface = say(Word::pores, pores);
    if (const std::string edges = edge_sentence(result, language_); !edges.empty())
      surface += (surface.empty() ? "" : " · ") + say(Word::edges, edges);
    if (!surface.empty()) section.parts.push_back(Paragraph{std::move(surface)});
    section.parts.push_back(Figures{{registration_figure(picture_, station, language_),
                                     seat_figure(picture_, station, language_), tolerance_figure(items, language_)}});
    return section;
  }

  const SlabPicture& picture_;
  const SlabRecord& record_;
  const SlabHeader& header_;
  Language language_;
  bool full_;
  std::string project_;
  std::vector<Finding> findings_;
};

}  // namespace

Report compose(const SlabPicture& picture, const Choice& choice) {
  return Composer(picture, choice).compose();
}

}  // namespace slabd::report
