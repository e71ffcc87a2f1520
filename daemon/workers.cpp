// SPDX-License-Identifier: Apache-2.0
#include "daemon/workers.h"

#include <array>

#include "algo/algo.h"
#include "base/pages.h"
#include "config/config.h"
#include "daemon/measure.h"
#include "daemon/slab_ends.h"

namespace slabd::daemon {
namespace {

class ThreadWorkers final : public Workers {
 public:
  ThreadWorkers(std::span<const Recipe> recipes, const ScanForms& scan_forms, const hal::Clock& clock,
                int measure_threads, bool simulation)
      : recipes_(recipes),
        scan_forms_(scan_forms),
        clock_(clock),
        simulation_(simulation),
        inspector_(measure_threads),
        scan_memory_(limits::scan_slots(scan_forms.size()) * limits::kScanSlotBytes) {
    for (std::size_t i = 0; i < limits::scan_slots(scan_forms.size()); ++i)
      slots_.at(i) = scan_memory_.take<float>(limits::kScanPointsMax * 3);
  }

  std::unique_ptr<StoreQueue> storage(std::function<StoreAnswer(const StoreTask&)> work,
                                      std::function<void()> idle) override {
    return std::make_unique<Worker<StoreTask, StoreAnswer, limits::kWorkerQueue>>("slabd-store", std::move(work),
                                                                                  std::move(idle));
  }
  std::unique_ptr<ScanQueue> scanner(std::size_t arm, std::function<ScanDone(const AcquireScan&)> work,
                                     std::function<void()> idle) override {
    constexpr std::array<const char*, limits::kArmsMax> kNames = {"slabd-scan", "slabd-scan-2"};
    return std::make_unique<Worker<AcquireScan, ScanDone, 4>>(kNames.at(arm), std::move(work), std::move(idle));
  }
  void remember(std::span<const KeptNoise> exposures) override {
    for (const KeptNoise& exposure : exposures) exposures_.add(exposure);
  }
  std::unique_ptr<MeasureQueue> measuring() override {
    return std::make_unique<Worker<MeasureBlock, BlockMeasured, 4>>(
        "slabd-measure", [this](const MeasureBlock& job) { return measure(job); }, [] {});
  }
  std::span<float> slot(std::size_t index) override { return slots_[index]; }
  std::optional<std::uint32_t> points_crc32c(const AcquiredScan& scan, std::size_t arm) override;
  void use_recipes(std::span<const Recipe> recipes) override {
    recipes_ = recipes;
    inspector_recipe_ = nullptr;
  }
  void give_up_measuring() override { inspector_.give_up(); }

 private:
  BlockMeasured measure(const MeasureBlock& job);
  void compare_exposure(const MeasureBlock& job, BlockMeasured& done);
  void refuse_exposure(const MeasureBlock& job, const FixedString<limits::kErrorTextBytes>& text, BlockMeasured& done);
  void look_at_slab_ends(const MeasureBlock& job, const algo::Cloud& cloud, BlockMeasured& done);
  Result<ScanShape> reload(const MeasureBlock& job);
  /// Form of the files of this arm; of the first one for a slab of a line that had more.
  [[nodiscard]] const hal::ScanForm& scan_form_of(std::size_t arm) const {
    return scan_forms_[arm < scan_forms_.size() ? arm : 0];
  }

  std::span<const Recipe> recipes_;
  ScanForms scan_forms_;
  const hal::Clock& clock_;
  bool simulation_;
  KnownExposures exposures_;                           ///< used by the measuring thread only
  std::array<FilterWatch, limits::kArmsMax> filters_;  ///< used by the measuring thread only
  SlabEnds slab_ends_;                                 ///< used by the measuring thread only
  bool blind_ends_said_ = false;
  algo::BlockInspector inspector_;
  const Recipe* inspector_recipe_ = nullptr;
  Pages scan_memory_;  ///< of the slots
  std::array<std::span<float>, limits::kScanSlotsMax> slots_;
};

/// Reads the scan of a block that was acquired before a restart. frame_incomplete if the file no longer contains those
/// points.
Result<ScanShape> ThreadWorkers::reload(const MeasureBlock& job) {
  const std::span<float> xyz = slots_[job.slot];
  const Result<ScanShape> read = hal::read_scan(job.scan_path.c_str(), scan_form_of(job.arm), xyz, inspector_.team());
  if (!read || !job.points_crc32c) return read;
  const std::uint32_t now = hal::points_crc32c(xyz.first(3 * read.value().points));
  if (now != *job.points_crc32c)
    return error(Code::frame_incomplete, "%s: its points are not those that were acquired: crc32c %08x then, %08x now",
                 job.scan_path.c_str(), *job.points_crc32c, now);
  return read;
}

BlockMeasured ThreadWorkers::measure(const MeasureBlock& job) {
  BlockMeasured done;
  done.id = job.id;
  done.slot = job.slot;
  done.block.station = job.id.station;
  const Recipe* recipe = job.basis.recipe;
  ScanShape shape = job.shape;
  double read_ms = job.read_ms;
  Code code = recipe == nullptr ? Code::unknown_type : Code::ok;
  if (code == Code::ok && job.reload) {
    const std::int64_t start_ns = clock_.mono_ns();
    const Result<ScanShape> read = reload(job);
    read_ms = ms_from_ns(clock_.mono_ns() - start_ns);
    if (read.ok()) {
      shape = read.value();
    } else {
      code = read.error().code;
      say_line({LogLine::Level::error, static_cast<std::uint16_t>(code), read.error().text});
    }
  }
  if (code != Code::ok) {
    done.block.verdict = Verdict::not_measured;
    done.block.reason = static_cast<std::uint16_t>(code);
    return done;
  }
  if (recipe != inspector_recipe_) {
    inspector_.use(*recipe);
    inspector_recipe_ = recipe;
    slab_ends_.use(recipes_, *recipe);
  }
  algo::Cloud cloud{slots_[job.slot], shape.points, shape.width, shape.height};
  const Status status = measure_block(
      inspector_, clock_, job.id.station,
      job.basis.T_base_slab * T_slab_block(*recipe, job.basis.slab.design, job.id.station), job.T_base_scanner, cloud,
      shape, read_ms, job.basis.verified.at(job.arm), job.basis.slab, job.scanner_drift);
  done.block = inspector_.result();
  pack_maps(inspector_, done.maps);
  compare_exposure(job, done);
  if (!status.ok()) {
    LogLine line{LogLine::Level::warning, static_cast<std::uint16_t>(status.error().code), {}};
    line.text.printf("station %u: %s", job.id.station, status.error().text.c_str());
    say_line(line);
    return done;
  }
  if (slab_ends_.is_needed()) look_at_slab_ends(job, cloud, done);
  if (const auto warning = scan_warning(done.block.scan); !warning.empty()) {
    LogLine line{LogLine::Level::warning, 0, {}};
    line.text.printf("station %u: %s", job.id.station, warning.c_str());
    say_line(line);
  }
  for (const SurfaceFinding& finding : done.block.findings) {
    LogLine line{LogLine::Level::warning, static_cast<std::uint16_t>(info(ItemId::block_damage).reason), {}};
    line.text.printf("station %u: %s", job.id.station, sentence(finding).c_str());
    say_line(line);
  }
  return done;
}

/// A refused scan is not stored, because the exposure that it repeats is stored already.
void ThreadWorkers::compare_exposure(const MeasureBlock& job, BlockMeasured& done) {
  inspector_.noise_print(done.noise);
  if (done.refused != Code::ok) return;
  FixedString<limits::kErrorTextBytes> text;
  const KeptNoise exposure{job.id.slab_key, job.id.station, job.id.attempt, done.noise};
  const bool has_print = !done.noise.empty();
  double correlation = 0.0;
  const KeptNoise* earlier = has_print ? exposures_.same_as(exposure, correlation) : nullptr;
  if (earlier != nullptr) {
    text.printf(
        "its noise is that of the exposure of slab key %lld, station %u, scan %u (correlation %.2f, of two "
        "exposures it is below %.2f): the scanner gave an earlier exposure again, perhaps in another form",
        static_cast<long long>(earlier->slab_key), earlier->station, earlier->attempt, correlation, kSameExposure);
    return refuse_exposure(job, text, done);
  }
  if (const double usual = filters_.at(job.arm).unlike(done.block.scan.lag_ratio); has_value(usual)) {
    text.printf(
        "its neighbouring points share their noise (%.1f) and those of the scans before did not (%.1f): it was "
        "smoothed "
        "unlike them, and an exposure given again is not recognised after that; if the filters of the scanner's "
        "program were changed on purpose, restart slabd",
        done.block.scan.lag_ratio, usual);
    return refuse_exposure(job, text, done);
  }
  if (has_print) exposures_.add(exposure);
}

void ThreadWorkers::refuse_exposure(const MeasureBlock& job, const FixedString<limits::kErrorTextBytes>& text,
                                    BlockMeasured& done) {
  if (simulation_) {
    // An emulated line may repeat the same noise.
    LogLine line{LogLine::Level::warning, static_cast<std::uint16_t>(Code::frame_incomplete), {}};
    line.text.printf("station %u: %s; accepted, because the line is emulated", job.id.station, text.c_str());
    say_line(line);
    return;
  }
  done.refused = Code::frame_incomplete;
  done.refused_text = text;
  done.block.verdict = Verdict::not_measured;
  done.block.reason = static_cast<std::uint16_t>(Code::frame_incomplete);
}

/// Refuses the scan if this slab's scans show the end of another slab type.
void ThreadWorkers::look_at_slab_ends(const MeasureBlock& job, const algo::Cloud& cloud, BlockMeasured& done) {
  if (done.refused != Code::ok) return;
  const Recipe& recipe = *inspector_recipe_;
  const TopView view =
      look_at_top(cloud.xyz.first(3 * cloud.points), done.block.registration.T_scanner_block.inverse(), recipe.block);
  const SlabEnds::Finding finding = slab_ends_.note(job.id.slab_key, job.id.station, view);
  if (finding.other != nullptr) {
    done.refused = Code::unknown_type;
    done.refused_text = text_of(finding, recipe);
    done.block.verdict = Verdict::not_measured;
    done.block.reason = static_cast<std::uint16_t>(Code::unknown_type);
    return;
  }
  const double blind_mm = slab_ends_.blind_reach_mm();
  if (blind_ends_said_ || !has_value(blind_mm)) return;
  blind_ends_said_ = true;
  LogLine line{LogLine::Level::warning, 0, {}};
  line.text.printf(
      "the scans of this slab reach %.0f mm from its outermost blocks and do not show where it ends: slab types that "
      "differ only there are not distinguished",
      blind_mm);
  say_line(line);
}

std::optional<std::uint32_t> ThreadWorkers::points_crc32c(const AcquiredScan& scan, std::size_t arm) {
  const Result<hal::ScanChecksum> read = hal::read_scan_checksum(scan.path.c_str(), scan_form_of(arm).unit);
  if (read.ok() && read.value().shape.points == scan.shape.points && read.value().shape.finite == scan.shape.finite)
    return read.value().crc32c;
  // The scan is still measured; without a checksum there is only less proof of its points.
  LogLine line{LogLine::Level::warning, 0, {}};
  line.text.printf("no checksum is kept of a scan: %s", read.ok() ? scan.path.c_str() : read.error().text.c_str());
  if (read.ok()) line.text.append(" no longer holds what was read from it");
  say_line(line);
  return std::nullopt;
}

}  // namespace

std::unique_ptr<Workers> make_workers(std::span<const Recipe> recipes, const ScanForms& scan_forms,
                                      const hal::Clock& clock, int measure_threads, bool simulation) {
  return std::make_unique<ThreadWorkers>(recipes, scan_forms, clock, measure_threads, simulation);
}

}  // namespace slabd::daemon
