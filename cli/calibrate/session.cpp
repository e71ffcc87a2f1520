// SPDX-License-Identifier: Apache-2.0
//
// The folder of a calibration. Two rules make it survive an interruption at any moment:
// - New data is collected under a name that begins with ".part-", synced, and renamed. A command is either not begun
// or done.
// - The state of a view (taken back, dropped, undone) is never overwritten. Every step is a file of its own next to
// the view, numbered over the whole session; the state is the sequence of the steps.
//
// A remaining ".part-" folder is an interrupted capture. Readers report it; the next capture, which holds the lock,
// deletes it, because its scans still exist at their source.
#include "cli/calibrate/session.h"

#include <fmt/core.h>
#include <sys/stat.h>
#include <algorithm>
#include <ctime>
#include <filesystem>
#include <limits>

#include "cli/calibrate/calibrate.h"
#include "cli/client/calibration_change.h"
#include "cli/terminal/say.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPart = ".part-";
constexpr const char* kIntent = "being-copied.txt";

Error cannot_make(const std::string& path, const std::error_code& fault) {
  return said_error(Code::journal_write, say("cannot make {}: {}", path, quote(fault.message())));
}

/// Sorted names of a folder's entries, because the order of a directory is undefined.
std::vector<std::string> names_in(const std::string& folder) {
  std::vector<std::string> names;
  std::error_code fault;
  for (fs::directory_iterator it(folder, fault), end; !fault && it != end; it.increment(fault))
    names.push_back(it->path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

/// Creates a folder with its parents; new ones belong to the group, like all files of slabd.
Status make_folders(const std::string& path) {
  std::error_code fault;
  fs::create_directories(path, fault);
  if (fault || !fs::is_directory(path, fault)) return cannot_make(path, fault);
  return success();
}

/// Creates a folder that is writable for the group, because another member may finish a calibration.
Status make_folder(const std::string& path) {
  std::error_code fault;
  if (!fs::create_directory(path, fault)) return cannot_make(path, fault);
  ::chmod(path.c_str(), 02775);
  return success();
}

std::size_t number_of(const std::string& name) {
  const bool digits = !name.empty() && name.size() < 7 &&
                      std::all_of(name.begin(), name.end(), [](char c) { return c >= '0' && c <= '9'; });
  return digits ? static_cast<std::size_t>(std::stoul(name)) : 0;
}

/// The step number in "drop-12.txt".
std::size_t step_of(const std::string& file) {
  const std::size_t from = file.find('-') + 1;
  return number_of(file.substr(from, file.rfind('.') - from));
}

}  // namespace

Status Session::create(const std::string& dir, const calib::SessionSettings& settings, const std::string& certificate) {
  std::error_code fault;
  const fs::path whole = fs::absolute(dir, fault).lexically_normal();
  const std::string target = whole.filename().empty() ? whole.parent_path().string() : whole.string();
  if (fs::exists(target, fault) && !(fs::is_directory(target, fault) && fs::is_empty(target, fault)))
    return said_error(
        Code::config,
        say("{} exists already; name another, or go on with it: slabctl calibrate list --session {}", target, target));
  const std::string parent = fs::path(target).parent_path().string();
  if (const Status made = make_folders(parent); !made.ok()) return made;
  const std::string part = parent + "/" + kPart + fs::path(target).filename().string();
  fs::remove_all(part, fault);  // left by an interrupted `new`; it contained no data
  for (const char* inner : {"", "/views", "/solutions"})
    if (const Status made = make_folder(part + inner); !made.ok()) return made;
  calib::SessionSettings agreed = settings;
  if (!certificate.empty()) agreed.certificate_sha256 = calib::sha256_hex(certificate);
  Status written = write_durably(part + "/session.txt", calib::session_text(agreed));
  if (written.ok() && !certificate.empty()) written = write_durably(part + "/certificate.txt", certificate);
  if (written.ok()) written = sync_folder(part);
  if (written.ok()) written = rename_durably(part, target);
  return written;
}

Result<Session> Session::open(const std::string& dir) {
  Session session;
  std::error_code fault;
  session.dir_ = fs::absolute(dir, fault).lexically_normal().string();
  while (session.dir_.size() > 1 && session.dir_.ends_with('/')) session.dir_.pop_back();
  const std::string file = session.dir_ + "/session.txt";
  const Result<std::string> text = text_file(file);
  if (!text.ok())
    return said_error(
        Code::config,
        say("{} is not a calibration session; begin one with: slabctl calibrate new NAME --help", session.dir_));
  Result<calib::SessionSettings> settings = calib::parse_session(text.value(), file);
  if (!settings.ok()) return settings.error();
  session.settings_ = std::move(settings.value());
  if (session.settings_.kind == calib::ArtefactKind::pose) {
    const Result<std::string> certificate = text_file(session.dir_ + "/certificate.txt");
    if (!certificate.ok()) return certificate.error();
    session.certificate_text_ = certificate.value();
    if (calib::sha256_hex(session.certificate_text_) != session.settings_.certificate_sha256)
      return said_error(Code::config, say("{}/certificate.txt was changed after the session began, and its views were "
                                          "made with its former content; "
                                          "put it back as it was, or begin another session with the new one",
                                          session.dir_));
    const auto parsed = calib::parse_certificate(session.certificate_text_, session.dir_ + "/certificate.txt");
    if (!parsed.ok()) return parsed.error();
  }
  session.read_views();
  session.read_solutions();
  return session;
}

void Session::read_views() {
  std::vector<Undo> undos;
  for (const std::string& name : names_in(dir_ + "/views")) {
    const std::string folder = dir_ + "/views/" + name;
    if (name.starts_with(kPart)) {
      const Result<std::string> intent = text_file(folder + "/" + kIntent);
      half_done_paths_.push_back(folder);
      half_done_.push_back(say("a capture was interrupted and is not used; capture it again: {}",
                               intent.ok() ? quote(intent.value()) : say("what it was is not known")));
      continue;
    }
    if (const std::size_t number = number_of(name); number != 0) read_view(number, folder, undos);
  }
  apply_steps(undos);
}

void Session::read_view(std::size_t number, const std::string& folder, std::vector<Undo>& undos) {
  Entry entry;
  entry.folder = folder;
  const Result<std::string> text = text_file(folder + "/view.txt");
  const auto view =
      text.ok() ? calib::parse_view(text.value(), folder + "/view.txt") : Result<calib::CapturedView>(text.error());
  if (view.ok())
    entry.view = view.value();
  else
    entry.unreadable = retold(view.error().text.view());
  if (view.ok() && view.value().number != number) entry.unreadable = say("{}: its view.txt is of another view", folder);
  entry.view.number = number;
  last_step_ = std::max(last_step_, entry.view.step);
  if (entry.unreadable.empty())
    steps_.push_back({entry.view.step, number, false, false, {}});
  else
    ++unreadable_steps_;
  read_view_changes(entry, undos);
  if (entry.unreadable.empty())
    for (const calib::KeptShot& shot : entry.view.shots) {
      std::error_code missing;
      if (fs::file_size(folder + "/" + shot.file, missing) == shot.bytes && !missing) continue;
      half_done_.push_back(
          say("view {}: its scan {} is gone or was changed; what was found in it still counts, but it cannot "
              "be examined again",
              number, folder + "/" + shot.file));
    }
  entries_.push_back(std::move(entry));
}

void Session::read_view_changes(Entry& entry, std::vector<Undo>& undos) {
  for (const std::string& file : names_in(entry.folder)) {
    const bool drop = file.starts_with("drop-");
    if (!(drop || file.starts_with("undo-")) || !file.ends_with(".txt")) continue;
    const Result<std::string> words = text_file(entry.folder + "/" + file);
    const auto change = words.ok() ? calib::parse_view_change(words.value(), entry.folder + "/" + file)
                                   : Result<calib::ViewChange>(words.error());
    if (!change.ok()) {
      // The state of the view is unknown, so it is not counted; the step number is not reused.
      entry.unreadable =
          say("{}; put that file back as it was, or remove it and drop the view again if it "
              "shall not count",
              quote(change.error().text.view()));
      last_step_ = std::max(last_step_, step_of(file));
      continue;
    }
    last_step_ = std::max(last_step_, change.value().step);
    if (drop)
      steps_.push_back({change.value().step, entry.view.number, true, false, change.value().why});
    else
      undos.push_back({entry.view.number, change.value().undoes});
  }
}

void Session::apply_steps(const std::vector<Undo>& undos) {
  for (const Undo& undo : undos)
    for (Step& step : steps_)
      if (step.view == undo.view && step.step == undo.step) step.taken_back = true;
  // An unreadable view may be repaired later, so its step number is not reused.
  last_step_ += unreadable_steps_;
  for (Entry& entry : entries_)
    for (const Step& step : steps_) {
      if (step.view != entry.view.number) continue;
      if (step.is_drop && !step.taken_back && step.step > entry.dropped_step) {
        entry.dropped_step = step.step;
        entry.dropped_why = step.why;
      }
      if (!step.is_drop && step.taken_back) entry.undone = true;
    }
}

void Session::read_solutions() {
  for (const std::string& name : names_in(dir_ + "/solutions")) {
    if (number_of(name) == 0) continue;
    const std::string folder = dir_ + "/solutions/" + name;
    last_step_ = std::max(last_step_, number_of(name));  // the number is used even if the content is invalid
    const Result<std::string> text = text_file(folder + "/solved.txt");
    const auto solved = text.ok() ? calib::parse_solved(text.value(), folder + "/solved.txt")
                                  : Result<calib::SolvedRecord>(text.error());
    if (!solved.ok()) {  // can be computed again at any time
      half_done_.push_back(say("{}; solve again", quote(solved.error().text.view())));
      continue;
    }
    last_step_ = std::max(last_step_, solved.value().step);
    solution_ = Solution{solved.value(), folder, std::nullopt};
    const Result<std::string> words = text_file(folder + "/verified.txt");
    if (!words.ok()) continue;
    const auto verified = calib::parse_verified(words.value(), folder + "/verified.txt");
    if (verified.ok()) solution_->verified = verified.value();
  }
}

std::size_t Session::counted(calib::ViewUse use) const {
  return static_cast<std::size_t>(std::count_if(
      entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.counts() && entry.view.use == use; }));
}

std::int64_t Session::oldest_utime_us() const {
  std::int64_t oldest = std::numeric_limits<std::int64_t>::max();
  for (const Entry& entry : entries_) {
    if (!entry.counts() || entry.view.use != calib::ViewUse::fit) continue;
    std::tm parts{};  // in the format of iso_time(); any other text counts as the oldest time
    const bool read = ::strptime(entry.view.captured.c_str(), "%Y-%m-%dT%H:%M:%SZ", &parts) != nullptr;
    oldest = std::min(oldest, read ? std::int64_t{::timegm(&parts)} * 1'000'000 : 0);
  }
  return oldest;
}

Result<std::vector<calib::View>> Session::views(calib::ViewUse use) const {
  std::vector<calib::View> views;
  for (const Entry& entry : entries_) {
    if (!entry.counts() || entry.view.use != use) continue;
    const Result<calib::View> view = calib::solver_view(settings_.kind, entry.view, entry.folder + "/view.txt");
    if (!view.ok()) return view.error();
    views.push_back(view.value());
  }
  return views;
}

std::string Session::inputs(calib::ViewUse use) const {
  const Result<std::vector<calib::View>> some = views(use);
  return calib::sha256_hex(some.ok() ? calib::solver_inputs(settings_, some.value()) : "");
}

calib::SolveSettings Session::solve_settings() const {
  calib::SolveSettings solve;
  solve.fov = settings_.fov;
  solve.point_sigma_mm_max = settings_.limit_mm;
  return solve;
}

calib::CoverageSettings Session::coverage_settings() const {
  calib::CoverageSettings coverage;
  coverage.fov = settings_.fov;
  coverage.down_base = settings_.down_base;
  coverage.goal = settings_.goal;
  if (const auto c = certificate())
    for (const Vec3& ball : c->balls_mm)
      coverage.target_radius_mm = std::max(coverage.target_radius_mm, ball.norm() + c->ball_radius_mm);
  if (const auto held_out = views(calib::ViewUse::held_out); held_out.ok())
    for (const calib::View& view : held_out.value()) coverage.taken.push_back(view.T_base_flange);
  // An artefact of any size may be off the centre and still be completely in the picture.
  coverage.target_radius_mm =
      std::min(coverage.target_radius_mm, 0.6 * std::min(settings_.fov.half_x_mm, settings_.fov.half_y_mm));
  return coverage;
}

calib::Guide Session::guide() const {
  const auto fit = views(calib::ViewUse::fit);
  return calib::guide_next(settings_.kind, fit.ok() ? fit.value() : std::vector<calib::View>{}, settings_.noise,
                           coverage_settings(), settings_.has_start ? &settings_.T_flange_scanner : nullptr);
}

std::optional<calib::ArtefactCertificate> Session::certificate() const {
  if (certificate_text_.empty()) return std::nullopt;
  const auto parsed = calib::parse_certificate(certificate_text_, "certificate.txt");
  if (!parsed.ok()) return std::nullopt;
  return parsed.value();
}

// ---- changes -----------------------------------------------------------------------------------------------------

Status Session::lock() {
  lock_.emplace();
  if (lock_->take(dir_ + "/lock")) {
    // The data read before the lock may be outdated.
    Result<Session> again = open(dir_);
    if (!again.ok()) return again.error();
    again.value().lock_.emplace(std::move(*lock_));
    *this = std::move(again.value());
    return success();
  }
  lock_.reset();
  return said_error(Code::config,
                    say("{}: another slabctl is working on this session, or it may not be written; try again", dir_));
}

Result<std::string> Session::begin_view(const std::string& intent) {
  std::error_code fault;
  for (const std::string& left : half_done_paths_) fs::remove_all(left, fault);
  half_done_paths_.clear();
  std::string part = dir_ + "/views/" + kPart + std::to_string(entries_.empty() ? 1 : entries_.back().view.number + 1);
  fs::remove_all(part, fault);
  if (const Status made = make_folder(part); !made.ok()) return made.error();
  if (const Status told = write_durably(part + "/" + kIntent, intent + "\n"); !told.ok()) return told.error();
  return part;
}

void Session::discard_view(const std::string& part) const {
  std::error_code fault;
  fs::remove_all(part, fault);
}

Status Session::commit_view(const std::string& part, calib::CapturedView& view) {
  view.number = entries_.empty() ? 1 : entries_.back().view.number + 1;
  view.step = last_step_ + 1;
  view.captured = report::iso_time(wall_clock_us());
  if (view.use == calib::ViewUse::fit &&
      calib::hold_out_next(settings_, counted(calib::ViewUse::fit) + counted(calib::ViewUse::held_out),
                           counted(calib::ViewUse::held_out)))
    view.use = calib::ViewUse::held_out;
  std::error_code fault;
  fs::remove(part + "/" + kIntent, fault);
  if (const Status written = write_durably(part + "/view.txt", calib::view_text(view)); !written.ok()) return written;
  if (const Status synced = sync_folder(part); !synced.ok()) return synced;
  Entry entry;
  entry.folder = dir_ + "/views/" + fmt::format("{:03}", view.number);
  if (const Status named = rename_durably(part, entry.folder); !named.ok()) return named;
  entry.view = view;
  entries_.push_back(entry);
  last_step_ = view.step;
  steps_.push_back({view.step, view.number, false, false, {}});
  return success();
}

Status Session::add_step(const Entry& entry, const std::string& word, const calib::ViewChange& change) {
  return write_durably(fmt::format("{}/{}-{}.txt", entry.folder, word, change.step), calib::change_text(change));
}

Status Session::drop(std::size_t number, const std::string& who, const std::string& why) {
  for (Entry& entry : entries_) {
    if (entry.view.number != number || entry.undone) continue;
    if (entry.dropped_step != 0)
      return said_error(Code::config,
                        say("view {} was dropped already ({}); take that back with: slabctl calibrate undo", number,
                            entry.dropped_why));
    const Status added = add_step(entry, "drop", {last_step_ + 1, 0, report::iso_time(wall_clock_us()), who, why});
    if (!added.ok()) return added;
    entry.dropped_step = ++last_step_;
    entry.dropped_why = why;
    steps_.push_back({last_step_, number, true, false, why});
    return success();
  }
  return said_error(Code::config, say("there is no view {}; slabctl calibrate list shows them", number));
}

Result<std::string> Session::undo(const std::string& who) {
  Step* newest = nullptr;
  for (Step& step : steps_)
    if (!step.taken_back && (newest == nullptr || step.step > newest->step)) newest = &step;
  if (newest == nullptr)
    return said_error(Code::config, say("there is nothing to undo; slabctl calibrate list shows the session"));
  for (Entry& entry : entries_) {
    if (entry.view.number != newest->view) continue;
    const Status added =
        add_step(entry, "undo", {last_step_ + 1, newest->step, report::iso_time(wall_clock_us()), who, ""});
    if (!added.ok()) return added.error();
    ++last_step_;
    newest->taken_back = true;
    if (newest->is_drop) {
      entry.dropped_step = 0;
      return say("view {} counts again: dropping it is undone", entry.view.number);
    }
    entry.undone = true;
    return say("view {} is taken back; its scans stay in {}", entry.view.number, entry.folder);
  }
  return said_error(Code::internal, say("step {} belongs to no view", newest->step));
}

Status Session::keep_solution(calib::SolvedRecord& record, const std::string& figures) {
  record.figures = calib::sha256_hex(figures);
  if (solution_ && solution_->record.inputs == record.inputs && solution_->record.figures == record.figures &&
      solution_->record.id == record.id && solution_->record.ok == record.ok) {
    record = solution_->record;
    return success();
  }
  record.step = last_step_ + 1;
  record.when = report::iso_time(wall_clock_us());
  const std::string folder = fmt::format("{}/solutions/{:04}", dir_, record.step);
  const std::string part = dir_ + "/solutions/" + kPart + std::to_string(record.step);
  std::error_code fault;
  fs::remove_all(part, fault);
  Status written = make_folder(part);
  if (written.ok()) written = write_durably(part + "/figures.json", figures);
  if (written.ok()) written = write_durably(part + "/solved.txt", calib::solved_text(record));
  if (written.ok()) written = rename_durably(part, folder);
  if (!written.ok()) return written;
  last_step_ = record.step;
  solution_ = Solution{record, folder, std::nullopt};
  return success();
}

void Session::leave_next_pose(const calib::Guide& guide) const {
  if (!guide.next) return;
  const std::array one = {guide.next->T_base_flange};
  static_cast<void>(
      write_durably(dir_ + "/next-pose.txt", calib::write_poses(one, calib::PoseFormat{}, calib::TableRole::flange)));
}

Status Session::keep_verified(const calib::VerifiedRecord& record) const {
  return write_durably(solution_->folder + "/verified.txt", calib::verified_text(record));
}

std::string session_words(const Session& session) {
  return say("session {} ({})", session.settings().name, session.dir());
}

}  // namespace slabd::cli
