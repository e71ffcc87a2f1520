// SPDX-License-Identifier: Apache-2.0
#include "tests/daemon/station/station_truth_parts.h"

#include <algorithm>

namespace slabd::daemon {

LineCalibration calibration_named(const CalibrationId& id) {
  LineCalibration calibration;
  calibration.source = LineCalibration::Source::applied;
  calibration.id = id;
  return calibration;
}

// ---- scanner -------------------------------------------------------------------------------------------------------

std::string ExposureTruth::text() const {
  if (slab_key == 0) return "no block";
  return "station " + std::to_string(station) + " of slab " + std::to_string(slab_key);
}

void TruthScanner::ask(const AcquireScan& action, const ExposureTruth& before_the_lens,
                       const std::vector<std::uint64_t>& delivered) {
  if (!is_frozen || held_.fingerprint == 0) {
    held_ = before_the_lens;
    held_.fingerprint = 1001 + 2 * exposures_.size();  // odd, as fingerprints of points are
    exposures_[held_.fingerprint] = held_;
  }
  request_.emplace();
  request_->action = action;
  request_->gives = held_;
  request_->turns_left = chance_.between(1, 60);
  if (all_is_well) return;
  // Returns an old file under the new name; the scanner still holds the new exposure.
  constexpr int kOldest = 20;  // well within the number of fingerprints that slabd stores
  if (!delivered.empty() && chance_.happens(0.03)) {
    const int back = chance_.between(1, std::min(kOldest, static_cast<int>(delivered.size())));
    const ExposureTruth old = truth_of(delivered[delivered.size() - static_cast<std::size_t>(back)]);
    if (old.fingerprint != 0) request_->gives = old;
  }
  const int end = chance_.between(0, 9);
  request_->end = end == 0 ? End::timeout : end == 1 ? End::torn : end == 2 ? End::no_room : End::good;
}

std::optional<ScanDone> TruthScanner::turn(std::int64_t now_ns) {
  if (!is_asked() || worker_hangs) return std::nullopt;
  // Points that are available may be reported in spite of a cancellation.
  if (request_->is_cancelled && (!request_->is_decoded || chance_.happens(0.1))) return last_word(Code::interrupted);
  if (--request_->turns_left > 0) return std::nullopt;
  if (request_->end == End::timeout) return last_word(Code::trigger_timeout);
  if (request_->end == End::torn) return last_word(Code::frame_incomplete);
  if (request_->is_decoded) return last_word(request_->end == End::no_room ? Code::store_full : Code::ok);

  request_->is_decoded = true;
  request_->turns_left = chance_.between(0, 30);
  slots_.at(request_->action.slot) = request_->gives;
  ScanDone done;
  done.cmd_seq = request_->action.request.cmd_seq;
  done.slot = request_->action.slot;
  done.fingerprint = request_->gives.fingerprint;
  done.scan.path = request_->action.request.spool_path;
  done.scan.shape = {1000, 900, 0, 0};
  done.scan.taken_mono_ns = now_ns - 5 * kNsPerMs;
  first_word_ = done;
  if (!all_is_well && chance_.happens(0.1)) return std::nullopt;  // the early event was lost
  return done;
}

ScanDone TruthScanner::last_word(Code code) {
  ScanDone done;
  if (request_->is_decoded) done = first_word_;
  done.cmd_seq = request_->action.request.cmd_seq;
  done.slot = request_->action.slot;
  done.code = code;
  done.durable = true;
  if (code == Code::ok) files_[std::string(done.scan.path.view())] = request_->gives;
  request_.reset();
  return done;
}

ExposureTruth TruthScanner::truth_of(std::uint64_t fingerprint) const {
  const auto found = exposures_.find(fingerprint);
  return found == exposures_.end() ? ExposureTruth{} : found->second;
}

ExposureTruth TruthScanner::in_file(const PathText& path) const {
  const auto found = files_.find(std::string(path.view()));
  return found == files_.end() ? ExposureTruth{} : found->second;
}

// ---- disk ----------------------------------------------------------------------------------------------------------

std::vector<StoreDone> TruthDisk::turn() {
  std::vector<StoreDone> answers;
  if (queue_.empty() || --turns_left_ > 0) return answers;
  turns_left_ = is_slow ? chance_.between(1, 150) : chance_.between(1, 3);
  do {
    answers.push_back(carry_out(queue_.front()));
    queue_.pop_front();
  } while (!is_slow && !queue_.empty());
  return answers;
}

StoreDone TruthDisk::carry_out(const StoreJob& job) {
  const bool of_scan =
      std::holds_alternative<SeenScanJob>(job.what) || std::holds_alternative<FailedAttemptJob>(job.what);
  const bool single = !all_is_well && chance_.happens(of_scan ? 0.1 : 0.01);
  const bool failing = fails || single;
  const bool is_done = !failing || chance_.happens(0.4);
  if (single && of_scan) is_telling_moment = true;
  StoreDone done;
  done.ticket = job.ticket;
  done.code = is_done ? store_.apply(job, failing) : Code::journal_write;
  store_.applied.clear();
  return done;
}

void TruthDisk::process_ends() {
  if (!queue_.empty() && !fails && chance_.happens(0.3))
    for (int done = chance_.between(1, static_cast<int>(queue_.size())); done > 0; --done) {
      (void)store_.apply(queue_.front());
      queue_.pop_front();
    }
  queue_.clear();
}

// ---- measuring -----------------------------------------------------------------------------------------------------

std::optional<BlockMeasured> TruthMeasuring::turn() {
  if (queue_.empty() || --queue_.front().turns_left > 0) return std::nullopt;
  const MeasureBlock job = queue_.front().job;
  queue_.pop_front();
  BlockMeasured done;
  done.id = job.id;
  done.slot = job.slot;
  done.block.station = job.id.station;
  done.block.verdict = Verdict::pass;
  if (!all_is_well && chance_.happens(0.3)) done.refused = Code::frame_incomplete;
  return done;
}

bool TruthMeasuring::uses(std::uint8_t slot) const {
  return std::any_of(queue_.begin(), queue_.end(), [slot](const Work& work) { return work.job.slot == slot; });
}

}  // namespace slabd::daemon
