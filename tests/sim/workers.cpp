// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/workers.h"

namespace slabd::sim {

daemon::BlockMeasured FiberWorkers::measure(const daemon::MeasureBlock& job) {
  daemon::BlockMeasured done;
  done.id = job.id;
  done.slot = job.slot;
  done.block.station = job.id.station;
  const Recipe* recipe = job.basis.recipe;
  Code code = recipe == nullptr ? Code::unknown_type : Code::ok;
  auto& slot = slots_[job.slot];
  if (code == Code::ok && job.reload) {
    process_.sleep_for(between(chance_, 40 * kMs, 200 * kMs));
    const ScanTruth scan = line_.in_spool(std::string(job.scan_path.view()));
    if (scan.take == 0)
      code = Code::frame_incomplete;
    else
      line_.write(scan, slot);
  }
  if (code != Code::ok) {
    done.block.verdict = Verdict::not_measured;
    done.block.reason = static_cast<std::uint16_t>(code);
    return done;
  }
  const ScanTruth shown = line_.read(slot);
  const bool slow = line_.world.faulty(Fault::measure_slow);
  process_.sleep_for(slow ? between(chance_, kSecond, 25 * kSecond) : between(chance_, 120 * kMs, 450 * kMs));
  if (process_.dead()) return done;
  if (line_.read(slot).take != shown.take)
    line_.world.violated("the buffer of station %u was written while it was measured", job.id.station);
  gauge(*recipe, job, shown, done.block);
  const std::tuple<std::int64_t, int, int> scan{job.id.slab_key, job.id.station, job.id.attempt};
  const heap::Aside aside;
  line_.refused.erase(scan);  // measured again, after a restart
  if (!line_.world.faulty(Fault::measure_refuses)) return done;
  line_.refused.insert(scan);
  done.refused = Code::frame_incomplete;
  done.refused_text = "another exposure than the requested one";
  return done;
}

}  // namespace slabd::sim
