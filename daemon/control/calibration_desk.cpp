// SPDX-License-Identifier: Apache-2.0
//
// slabctl writes a change as a file and tells its name over the control socket. Whoever may write to the socket is in
// the daemon's group and may apply a calibration; so the file is taken from one folder only, by a plain name, without
// following links, and the database says itself whether the change makes sense.
#include "daemon/control/calibration_desk.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <exception>
#include <filesystem>

#include "base/os.h"
#include "config/config.h"
#include "daemon/control/calibration_change.h"

namespace slabd::daemon {
namespace {

constexpr std::size_t kChangeBytesMax = 64U << 20U;
constexpr std::uint32_t kNobody = 0xFFFF'FFFF;

/// Letters, digits, '-', '_' and '.', and no leading dot: nothing that leads out of the folder.
bool is_plain_name(const std::string& name) {
  if (name.empty() || name.size() > 100 || name.front() == '.') return false;
  for (const char c : name) {
    const bool plain =
        (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '_' || c == '.';
    if (!plain) return false;
  }
  return true;
}

Result<std::string> read_change(const std::string& path) {
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (!file.is_open()) return error(Code::config, "cannot open %s: %s", path.c_str(), std::strerror(errno));
  struct stat status {};
  const bool regular = ::fstat(file.get(), &status) == 0 && S_ISREG(status.st_mode);
  if (!regular || static_cast<std::size_t>(status.st_size) > kChangeBytesMax)
    return error(Code::config, "%s is no regular file of at most 64 MB", path.c_str());
  std::string text(static_cast<std::size_t>(status.st_size), '\0');
  std::size_t got = 0;
  while (got < text.size()) {
    const ssize_t n = ::read(file.get(), text.data() + got, text.size() - got);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    got += static_cast<std::size_t>(n);
  }
  if (got != text.size()) return error(Code::config, "%s was cut short while it was read", path.c_str());
  return text;
}

/// Who asked stands in the history, whatever name was given.
void note_user(storage::CalibrationChange& change, std::uint32_t uid) {
  const std::string user = " (uid " + std::to_string(uid) + ")";
  if (auto* apply = std::get_if<storage::ApplyCalibration>(&change); apply != nullptr && !apply->note.who.empty())
    apply->note.who += user;
  if (auto* back = std::get_if<storage::RollBackCalibration>(&change); back != nullptr && !back->note.who.empty())
    back->note.who += user;
}

}  // namespace

std::string change_folder(const std::string& db_path) {
  return db_path.empty() ? "" : db_path.substr(0, db_path.rfind('/') + 1) + "changes";
}

CalibrationDesk::CalibrationDesk(std::string folder) : folder_(std::move(folder)) {
  // Whoever may use the control socket may leave a file here; a folder that cannot be made shows when one is read.
  if (!folder_.empty() && ::mkdir(folder_.c_str(), 0770) == 0) static_cast<void>(::chmod(folder_.c_str(), 02770));
}

Status CalibrationDesk::lay(const std::string& file, std::uint32_t uid) {
  if (folder_.empty()) return slabd::error(Code::config, "the daemon has no database");
  if (phase_ != Phase::idle) return slabd::error(Code::busy, "another change of calibrations is under way; try again");
  if (uid == kNobody) return slabd::error(Code::config, "who asks for this change is not known");
  if (!is_plain_name(file))
    return slabd::error(Code::config, "\"file\" must be a plain name of a file in %s", folder_.c_str());
  phase_ = Phase::waiting;
  file_.assign(file);
  uid_ = uid;
  error_ = {Code::ok, {}};
  id_.clear();
  calibration_.reset();
  return success();
}

void CalibrationDesk::carry_out(storage::Store* store) {
  const std::string path = folder_ + "/" + file_.c_str();
  try {
    const Result<std::string> text = read_change(path);
    if (!text.ok()) {
      error_ = text.error();
      return;
    }
    Result<storage::CalibrationChange> change = parse_change(text.value());
    if (!change.ok()) {
      error_ = change.error();
    } else if (store == nullptr) {
      error_ = slabd::error(Code::journal_write, "the daemon has no usable database");
    } else {
      note_user(change.value(), uid_);
      const Result<std::string> done = store->change(change.value());
      if (done.ok())
        id_.assign(done.value());
      else
        error_ = done.error();
      // A change that was refused is not there. One that failed may be: what is in force is what the database says.
      if (done.ok() || error_.code != Code::config) {
        Result<std::unique_ptr<LineCalibration>> now = store->calibration();
        if (now.ok()) calibration_ = std::move(now.value());
        if (done.ok() && !now.ok()) error_ = now.error();
      }
      if (!done.ok() && error_.code != Code::config)
        error_.text.append("; it may have been made all the same: slabctl calibrate history tells");
    }
  } catch (const std::exception& e) {
    error_ = slabd::error(Code::internal, "%s: %s", path.c_str(), e.what());
  }
  ::unlink(path.c_str());
}

const LineCalibration* CalibrationDesk::finish() {
  phase_ = Phase::idle;
  shown_error_ = error_;
  shown_id_ = id_;
  return calibration_.get();
}

FixedString<limits::kErrorTextBytes> CalibrationDesk::summary() const {
  FixedString<limits::kErrorTextBytes> text;
  if (succeeded()) {
    text.printf("calibration change %s by uid %u: %s", file_.c_str(), uid_, id_.c_str());
  } else {
    text.printf("calibration change %s by uid %u refused: %s", file_.c_str(), uid_, error_.text.c_str());
  }
  return text;
}

}  // namespace slabd::daemon
