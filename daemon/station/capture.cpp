// SPDX-License-Identifier: Apache-2.0
//
// Maintenance: views for a calibration, from the line's own robot and scanner, while no slab is open.
//
//   idle --begin--> ready --shoot--> settling -> scanning -> checking --> ready --end, or the lease is over--> idle
//
// A view is taken like a production scan: the robot stands still, the scan is requested, and the robot must not have
// moved. The limits are stricter, and the scan is stored separately. Invariants: a refused view leaves no scan, and
// shooting may be repeated; a view is never a scan taken before its request. Meanwhile the PLC cannot start a command.
// If the operator's program ends without releasing the line, the lease ends maintenance. A restart keeps only the mark
// that the scanner may hold an unseen scan.
//
// A request to the scanner must not have the name of a production request, because a late answer would be taken for a
// slab's scan. Therefore views use session 0, which the PLC never has, and numbers that start at a value from the
// clock.
#include <algorithm>
#include <cmath>
#include <optional>

#include "daemon/station/parts.h"
#include "daemon/station/still_watch.h"

namespace slabd::daemon {
namespace {

/// A view may show only a ball; the program that locates the ball checks its number of points.
constexpr std::size_t kViewPointsMin = 1'000;
constexpr std::int64_t kLeaseMinS = 10;
constexpr std::int64_t kLeaseMaxS = 3600;
/// Additional time for a worker that hangs, compared with a robot that does not stand still.
constexpr std::int64_t kHangTimeout_ns = 20 * kNsPerS;

/// Text for a view that was discarded.
constexpr std::string_view kUnseenView =
    "a scan was requested before and not received, and this one may be that; it was discarded: take the view again";

bool is_text(std::string_view text) {
  return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    const auto byte = static_cast<unsigned char>(c);
    return byte >= 0x20 && byte != 0x7F;
  });
}

StationArm& arm_of(Station& s) {
  return s.arms[s.capture.arm];
}
const StationArm& arm_of(const Station& s) {
  return s.arms[s.capture.arm];
}

void renew(Station& s) {
  s.capture.lease_until_ns = s.now_ns + s.capture.lease_ns;
}

/// A view that ends before the request leaves the scanner unchanged. The stored mark stays, so that after a restart one
/// additional scan is taken.
void withdraw_mark(Station& s) {
  const Capture& c = s.capture;
  if (c.phase == Capture::Phase::settling && c.mark != Capture::Mark::none && !c.unseen) arm_of(s).scan_unseen = false;
}

void close(Station& s, Actions& actions, const char* why) {
  withdraw_mark(s);
  log(actions, LogLine::Level::info, Code::ok, "maintenance of \"%s\" by %s ends after %u views: %s",
      s.capture.session.c_str(), s.capture.operator_name.c_str(), s.capture.shot.number, why);
  s.capture = {};
}

// ---- permission and ownership of a session ----

/// Reason why a session may not begin; ok if the line is idle.
Error line_is_free(const Station& s) {
  if (!s.recovered) return error(Code::busy, "slabd is still starting; try again");
  if (s.slab.phase != SlabPhase::none) {
    const int done =
        static_cast<int>(std::count_if(s.slab.stations.begin(), s.slab.stations.end(), [](const StationRecord& record) {
          return record.phase == StationPhase::acquired || record.phase == StationPhase::measured;
        }));
    return error(Code::busy,
                 "slab %u \"%s\" is open, %d of %u stations are scanned; let the line finish it, or have the PLC send "
                 "SLAB_ABORT",
                 s.slab.header.slab_no, s.slab.header.slab_id.c_str(), done, s.slab.header.stations);
  }
  if (s.command.pending)
    return error(Code::busy, "the PLC's command %u (CMD %u) is being carried out; try again",
                 s.command.pending_inputs.cmd_seq, s.command.pending_inputs.command);
  // A missing calibration blocks slabs only; maintenance is needed to create one.
  const Code fault = current_fault(s);
  if (fault != Code::ok && fault != Code::calibration_missing)
    return error(fault, "fault %u: %.*s; %.*s", static_cast<unsigned>(fault), static_cast<int>(describe(fault).size()),
                 describe(fault).data(), static_cast<int>(cure(fault).size()), cure(fault).data());
  return {Code::ok, {}};
}

/// The arm whose scanner has this id; the only one if the id is empty. nullopt if there is none, or several.
std::optional<std::uint8_t> arm_named(const Station& s, const PartId& scanner) {
  for (std::size_t arm = 0; arm < arm_count(s); ++arm)
    if (s.settings.arms.list[arm].scanner == scanner || (scanner.empty() && !s.settings.arms.several()))
      return static_cast<std::uint8_t>(arm);
  return std::nullopt;
}

FixedString<limits::kErrorTextBytes> scanner_ids(const Station& s) {
  FixedString<limits::kErrorTextBytes> ids;
  for (const Arm& arm : s.settings.arms.list) {
    if (!ids.empty()) ids.append(", ");
    ids.append(arm.scanner.view());
  }
  return ids;
}

void begin(Station& s, const CaptureRequest& request, Actions& actions) {
  Capture& c = s.capture;
  const std::optional<std::uint8_t> arm = arm_named(s, request.scanner);
  if (!arm) {
    c.refusal = error(Code::config, "\"scanner\" must be one of: %s", scanner_ids(s).c_str());
    return;
  }
  if (!is_text(request.session.view()) || !is_text(request.operator_name.view())) {
    c.refusal = error(Code::config, "\"session\" and \"operator\" must be texts of 1..%zu and 1..%zu bytes",
                      CaptureName::capacity(), decltype(request.operator_name)::capacity());
    return;
  }
  if (request.lease_s < kLeaseMinS || request.lease_s > kLeaseMaxS) {
    c.refusal = error(Code::config, "\"lease_s\" must be %lld..%lld s", static_cast<long long>(kLeaseMinS),
                      static_cast<long long>(kLeaseMaxS));
    return;
  }
  const bool open = in_maintenance(s) && !c.ending;
  if (open && c.session == request.session && c.arm == *arm) {
    c.operator_name = request.operator_name;
    c.uid = request.uid;
    c.lease_ns = request.lease_s * kNsPerS;
    renew(s);
    return;
  }
  if (in_maintenance(s)) {
    const auto left_s = static_cast<long long>((c.lease_until_ns - s.now_ns + kNsPerS - 1) / kNsPerS);
    if (c.ending || c.phase != Capture::Phase::ready) {
      c.refusal =
          error(Code::busy, "\"%s\" of %s is taking a view; try again", c.session.c_str(), c.operator_name.c_str());
      return;
    }
    if (!request.take_over) {
      c.refusal = error(Code::busy,
                        "\"%s\" of %s stays open for another %lld s if it does not continue; end it, wait, or give "
                        "slabctl calibrate capture --live also --take-over",
                        c.session.c_str(), c.operator_name.c_str(), std::max(left_s, 0LL));
      return;
    }
    close(s, actions, "another one takes over");
  }
  if (Error why = line_is_free(s); why.code != Code::ok) {
    c.refusal = why;
    return;
  }
  c.phase = Capture::Phase::ready;
  c.arm = *arm;
  c.session = request.session;
  c.operator_name = request.operator_name;
  c.uid = request.uid;
  c.since_utime_us = s.utime_us;
  c.lease_ns = request.lease_s * kNsPerS;
  renew(s);
  arm_of(s).still.begin();
  log(actions, LogLine::Level::info, Code::ok,
      "maintenance (STATE 8)%s: \"%s\" by %s (uid %u); SLAB_BEGIN and SCAN are refused with 107",
      arm_words(s, c.arm).c_str(), c.session.c_str(), c.operator_name.c_str(), c.uid);
  if (s.settings.capture.is_wider())
    log(actions, LogLine::Level::warning, Code::ok,
        "views are taken with wider limits than they should be: %.3f mm, %.4f deg over %.1f s",
        s.settings.capture.stable_mm, deg_from_rad(s.settings.capture.stable_rad),
        static_cast<double>(s.settings.capture.stable_ns) / 1e9);
  emit(actions, TidyCaptures{capture_folder(s)});
}

// ---- one view ----

void refuse_shot(Station& s, Code code, std::string_view why, Actions& actions) {
  Capture& c = s.capture;
  withdraw_mark(s);
  give_back(s, c.exposure);
  c.shot.done = true;
  c.shot.code = code;
  c.shot.text = why;
  c.phase = Capture::Phase::ready;
  renew(s);
  log(actions, LogLine::Level::warning, code, "view %u failed: %s", c.shot.number, c.shot.text.c_str());
  if (c.ending) close(s, actions, "ended");
}

void refuse_shot(Station& s, const Error& why, Actions& actions) {
  refuse_shot(s, why.code, why.text.view(), actions);
}

/// Reason why the robot does not count as still, for display.
Error why_not_still(const Station& s) {
  const StillWatch& still = arm_of(s).still;
  const double stood_s =
      still.samples() < 2 ? 0.0 : static_cast<double>(still.newest().arrival_ns - still.first().arrival_ns) / 1e9;
  const StillWatch::Broken& last = still.last_break();
  const bool by_motion = last.by == StillWatch::Break::moved;
  const FixedString<240> what = still.describe(by_motion ? StillWatch::Broken{} : last);
  return error(last.by == StillWatch::Break::wrong_frame ? Code::wrong_frame : Code::not_settled,
               "the robot is not at rest: %s; it was at rest for %.1f s of %.1f s", what.c_str(), stood_s,
               static_cast<double>(s.settings.capture.stable_ns) / 1e9);
}

void shoot(Station& s) {
  Capture& c = s.capture;
  const std::uint32_t number = c.shot.number + 1;
  c.shot = {};
  c.shot.number = number;
  c.phase = Capture::Phase::settling;
  c.exposure = {};
  c.unseen = false;
  c.mark = Capture::Mark::none;
  c.started_ns = s.now_ns;
  // Only poses that arrive from now on count. The robot was stopped before the view was requested, and an earlier pose
  // may be from its motion.
  arm_of(s).still.begin();
}

Error scanner_does_not_answer(const Station& s) {
  return error(code_of_hang(s, s.capture.arm), "%s (slabctl status)", why_it_hangs(s, s.capture.arm));
}

bool is_out_of_patience(const Station& s, std::int64_t more_ns = 0) {
  return s.now_ns - s.capture.started_ns >
         s.settings.arm(s.capture.arm).settle_timeout_ns + s.settings.capture.stable_ns + more_ns;
}

/// Stores that the scanner may hold an unseen view, for a restart. The fingerprint of its points replaces the mark
/// later.
void mark_unseen(Station& s, Actions& actions) {
  Capture& c = s.capture;
  if (c.mark == Capture::Mark::none) {
    c.mark = Capture::Mark::storing;
    c.unseen = arm_of(s).scan_unseen;
    arm_of(s).scan_unseen = true;
    store_fingerprint(s, kUnseenScan, actions);
    c.mark_ticket = s.last_ticket;
  } else if (is_out_of_patience(s, kCheckTimeout_ns)) {
    refuse_shot(s, error(Code::deadline, "the database did not answer in time; check the disk"), actions);
  }
}

void try_to_ask_scanner(Station& s, Actions& actions) {
  Capture& c = s.capture;
  StationArm& arm = arm_of(s);
  const Code link = arm.gate.link(s.now_ns);
  const bool room = s.storing.size() + 8 <= s.storing.capacity();  // for storing the fingerprints of the view
  const int slot = room ? free_slot(s) : -1;
  const bool scanner_hangs = arm.abandoned.waits || arm.links.scanner_hangs;
  if (link != Code::ok || !arm.still.settled() || slot < 0 || scanner_hangs) {
    if (!is_out_of_patience(s)) return;
    if (link == Code::no_pose || link == Code::pose_stale) {
      refuse_shot(s,
                  error(link, "%.*s; %.*s", static_cast<int>(describe(link).size()), describe(link).data(),
                        static_cast<int>(cure(link).size()), cure(link).data()),
                  actions);
    } else if (!arm.still.settled()) {
      refuse_shot(s, why_not_still(s), actions);
    } else if (scanner_hangs) {
      refuse_shot(s, scanner_does_not_answer(s), actions);
    } else {
      refuse_shot(s, error(Code::deadline, "no buffer became free for the scan; check the computer's load"), actions);
    }
    return;
  }
  if (c.mark != Capture::Mark::durable) {
    mark_unseen(s, actions);
    return;
  }
  c.phase = Capture::Phase::scanning;
  c.shot.requested_utime_us = s.utime_us;
  arm.still.mark();

  ScanRequest request;
  request.session = 0;
  request.cmd_seq = next_own_request(s);
  request.slab_id = "calibration";
  request.timeout_ns = s.settings.arm(c.arm).scan_timeout_ns;
  if (s.settings.arms.several()) request.by = s.settings.arms.list[c.arm];
  request.points_min = kViewPointsMin;
  request.spool_path.printf("%s/%lld-%u", capture_folder(s).c_str(), static_cast<long long>(s.utime_us / 1'000'000),
                            unsigned{request.cmd_seq});
  ask_scanner(s, c.exposure, c.arm, slot, request, actions);
}

void give_up_when_scanner_hangs(Station& s, Actions& actions) {
  Capture& c = s.capture;
  const std::int64_t patience_ns =
      s.settings.arm(c.arm).settle_timeout_ns + s.settings.capture.stable_ns + kHangTimeout_ns;
  if (!give_up_when_worker_hangs(s, c.exposure, c.started_ns, patience_ns, actions)) return;
  refuse_shot(s, scanner_does_not_answer(s), actions);
}

void check_stillness(Station& s, Actions& actions) {
  Capture& c = s.capture;
  const StillWatch& still = arm_of(s).still;
  const StillWatch::Broken& broken = still.first_break();
  if (broken.by != StillWatch::Break::none) {
    emit(actions, DropScan{c.shot.scan_path});
    const FixedString<240> what = still.describe(broken);
    refuse_shot(
        s,
        error(broken.by == StillWatch::Break::wrong_frame                                    ? Code::wrong_frame
              : broken.by == StillWatch::Break::gap || broken.by == StillWatch::Break::clock ? Code::pose_stale
                                                                                             : Code::moved_during_scan,
              "while the scan was taken: %s", what.c_str()),
        actions);
    return;
  }
  if (still.newest().arrival_ns <= c.exposure.taken_ns) {
    if (s.now_ns - c.exposure.taken_ns < kCheckTimeout_ns) return;
    emit(actions, DropScan{c.shot.scan_path});
    refuse_shot(s, error(Code::pose_stale, "no pose arrived after the scan; check the robot bridge and its network"),
                actions);
    return;
  }
  CaptureShot& shot = c.shot;
  shot.T_base_flange = still.mean();
  shot.spread_mm = still.range().mm();
  shot.spread_rad = still.range().rad();
  shot.samples = still.samples();
  shot.first = still.first();
  shot.last = still.newest();
  shot.pose_age_us = s.utime_us - shot.last.utime_us;
  shot.done = true;
  c.phase = Capture::Phase::ready;
  renew(s);
  log(actions, LogLine::Level::info, Code::ok, "view %u: %zu points, the flange stayed within %.4f mm and %.5f deg",
      shot.number, shot.shape.finite, shot.spread_mm, deg_from_rad(shot.spread_rad));
}

void end(Station& s, Actions& actions, const char* why) {
  Capture& c = s.capture;
  if (c.phase == Capture::Phase::scanning) {
    c.ending = true;
    abort_shot(s, actions);
    return;
  }
  if (c.phase == Capture::Phase::checking) emit(actions, DropScan{c.shot.scan_path});
  close(s, actions, why);
}

/// True only for files that this daemon stored: a plain name in its own folder.
bool is_view(const Station& s, std::string_view path) {
  const PathText folder = capture_folder(s);
  if (!path.starts_with(folder.view()) || path.size() <= folder.size() + 1 || path[folder.size()] != '/') return false;
  const std::string_view name = path.substr(folder.size() + 1);
  return name.find('/') == std::string_view::npos && name.front() >= '0' && name.front() <= '9';
}

}  // namespace

PathText capture_folder(const Station& s) {
  PathText folder = s.settings.spool_dir;
  folder.append("/capture");
  return folder;
}

void on_capture_request(Station& s, const CaptureRequest& request, Actions& actions) {
  Capture& c = s.capture;
  c.refusal = {Code::ok, {}};
  if (request.action == CaptureRequest::Action::begin) {
    begin(s, request, actions);
    return;
  }
  if (request.action == CaptureRequest::Action::release) {
    if (is_view(s, request.scan.view()))
      emit(actions, DropScan{request.scan});
    else
      c.refusal = error(Code::config, "%.150s is not in %.100s", request.scan.c_str(), capture_folder(s).c_str());
  }
  const bool ours = in_maintenance(s) && !c.ending && c.session == request.session;
  if (!ours) {
    // The scans of a finished session may still be released; the other actions need an open session.
    const bool needs_one =
        request.action == CaptureRequest::Action::shoot || request.action == CaptureRequest::Action::keep;
    if (needs_one)
      c.refusal = error(Code::wrong_slab,
                        "\"%s\" is not open (never begun, ended, its lease over, or slabd restarted); begin it again",
                        request.session.c_str());
    return;
  }
  renew(s);
  switch (request.action) {
    case CaptureRequest::Action::shoot:
      if (c.phase != Capture::Phase::ready)
        c.refusal = error(Code::busy, "view %u is being taken", c.shot.number);
      else
        shoot(s);
      break;
    case CaptureRequest::Action::end: end(s, actions, "ended"); break;
    case CaptureRequest::Action::begin:
    case CaptureRequest::Action::keep:
    case CaptureRequest::Action::release: break;
  }
}

void advance_capture(Station& s, Actions& actions) {
  switch (s.capture.phase) {
    case Capture::Phase::ready:
      if (s.now_ns >= s.capture.lease_until_ns) close(s, actions, "no further step arrived, its lease has expired");
      break;
    case Capture::Phase::settling: try_to_ask_scanner(s, actions); break;
    case Capture::Phase::checking: check_stillness(s, actions); break;
    case Capture::Phase::scanning: give_up_when_scanner_hangs(s, actions); break;
    case Capture::Phase::closed: break;
  }
}

void on_view_marked(Station& s, std::uint32_t ticket, Code code, Actions& actions) {
  Capture& c = s.capture;
  if (c.mark != Capture::Mark::storing || ticket != c.mark_ticket) return;
  if (code != Code::ok && c.phase == Capture::Phase::settling) refuse_shot(s, code, describe(code), actions);
  c.mark = code == Code::ok ? Capture::Mark::durable : Capture::Mark::none;
}

void on_view_scanned(Station& s, const ScanDone& done, Actions& actions) {
  Capture& c = s.capture;
  Exposure& e = c.exposure;
  if (done.code == Code::ok && !e.looked_at) {
    e.looked_at = true;
    const bool repeats = was_seen(s, done, actions);
    if (!repeats) arm_of(s).scan_unseen = false;
    e.repeats = repeats && !s.settings.simulation;
  }
  if (!done.durable) return;
  // The first scan after an unseen one may be that scan, taken from another position.
  const bool late = c.unseen && !s.settings.simulation;
  if (done.code != Code::ok || e.abort || e.repeats || late) {
    if (done.code == Code::ok) emit(actions, DropScan{done.scan.path});
    const Code code = e.abort ? Code::interrupted : done.code != Code::ok ? done.code : Code::frame_incomplete;
    const std::string_view why = e.abort                 ? "it was broken off"
                                 : e.repeats             ? kRepeatedScan
                                 : done.code == Code::ok ? kUnseenView
                                 : !done.text.empty()    ? done.text.view()
                                                         : describe(code);
    refuse_shot(s, code, why, actions);
    return;
  }
  give_back(s, e);  // a view is not measured here; only its file is used
  e.taken_ns = done.scan.taken_mono_ns;
  c.shot.scan_path = done.scan.path;
  c.shot.shape = done.scan.shape;
  note_scanner_temperature(s, c.arm, done.scan.shape.scanner_temperature_c, actions);
  c.shot.scan_utime_us = done.scan.taken_utime_us;
  c.phase = Capture::Phase::checking;
}

void abort_shot(Station& s, Actions& actions) {
  Capture& c = s.capture;
  switch (c.phase) {
    case Capture::Phase::scanning: break_off(c.exposure, actions); break;
    case Capture::Phase::checking: emit(actions, DropScan{c.shot.scan_path}); [[fallthrough]];
    case Capture::Phase::settling: refuse_shot(s, Code::interrupted, "it was broken off by ABORT", actions); break;
    case Capture::Phase::closed:
    case Capture::Phase::ready: break;
  }
}

}  // namespace slabd::daemon
