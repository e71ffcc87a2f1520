// SPDX-License-Identifier: Apache-2.0
#include "emulator/scan_outlet.h"

#include <fmt/core.h>
#include <unistd.h>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <thread>

#include "base/result.h"
#include "emulator/stream_gateway.h"
#include "hal/hal.h"

namespace slabd::emulator {
namespace {

/// The scanner software's side of a drop directory: finds waiting requests and delivers answers to the inbox. Used by
/// one thread.
class DropAnswers {
 public:
  /// Code::scanner_offline if the folder has no usable request/ and inbox/ (the daemon creates them). Requests that
  /// already exist are for another scanner and are ignored.
  [[nodiscard]] static Result<DropAnswers> open(const std::string& drop_dir);

  /// "<session>-<seq>" of a request without an answer, or empty. `trouble` is set if one cannot be read.
  [[nodiscard]] std::string pending(std::string& trouble);
  /// Path for a scan before it is delivered, on the inbox's file system. Deleted by remove_part().
  [[nodiscard]] const std::filesystem::path& part_path() const { return part_path_; }
  /// Moves the scan at part_path() into the inbox as the answer to `name`, which is then no longer pending.
  /// Code::scanner_offline if it cannot be moved.
  [[nodiscard]] Status deliver(const std::string& name, hal::ScanFormat format);
  /// Marks the request as answered without a scan.
  void give_up(const std::string& name) { answered_.insert(name); }
  void remove_part() const;

 private:
  std::filesystem::path request_dir_;
  std::filesystem::path inbox_dir_;
  std::filesystem::path part_path_;
  std::set<std::string> answered_;
};

namespace fs = std::filesystem;

Result<DropAnswers> DropAnswers::open(const std::string& drop_dir) {
  DropAnswers answers;
  answers.request_dir_ = fs::path(drop_dir) / "request";
  answers.inbox_dir_ = fs::path(drop_dir) / "inbox";
  answers.part_path_ = fs::path(drop_dir) / fmt::format("emulated-scan-{}.part", ::getpid());
  std::error_code fault;
  const auto is_there = [&] {
    return fs::is_directory(answers.request_dir_, fault) && fs::is_directory(answers.inbox_dir_, fault);
  };
  // A daemon that has just been started creates the folders after it has read its database.
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  while (!is_there() && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  if (!is_there())
    return error(Code::scanner_offline,
                 "%s has no request/ and inbox/: create the folder for slabd, which makes them, and start slabd first",
                 drop_dir.c_str());
  if (::access(answers.inbox_dir_.c_str(), W_OK | X_OK) != 0 || ::access(drop_dir.c_str(), W_OK | X_OK) != 0)
    return error(Code::scanner_offline, "%s cannot be written by this user: run as a member of the daemon's group",
                 drop_dir.c_str());
  for (fs::directory_iterator entry(answers.request_dir_, fault), end; !fault && entry != end; entry.increment(fault))
    answers.answered_.insert(entry->path().stem());
  return answers;
}

std::string DropAnswers::pending(std::string& trouble) {
  std::error_code fault;
  for (fs::directory_iterator entry(request_dir_, fault), end; !fault && entry != end; entry.increment(fault)) {
    if (entry->path().extension() != ".json") continue;
    const std::string name = entry->path().stem();
    if (answered_.contains(name)) continue;
    std::ifstream file(entry->path());
    const auto request = nlohmann::json::parse(file, nullptr, false);
    if (!request.is_object() || request.value("schema", "") != "slabd.scan_request/1") {
      trouble = fmt::format("{}: not a slabd.scan_request/1", entry->path().string());
      answered_.insert(name);
      continue;
    }
    return name;
  }
  return {};
}

Status DropAnswers::deliver(const std::string& name, hal::ScanFormat format) {
  answered_.insert(name);
  std::error_code fault;
  fs::rename(part_path_, inbox_dir_ / fmt::format("{}.{}", name, hal::extension(format)), fault);
  if (!fault) return success();
  return error(Code::scanner_offline, "cannot move a scan into %s: %s", inbox_dir_.c_str(), fault.message().c_str());
}

void DropAnswers::remove_part() const {
  std::error_code ignored;
  fs::remove(part_path_, ignored);
}

/// Factor that converts a length in mm to the unit.
double per_mm(hal::LengthUnit unit) {
  switch (unit) {
    case hal::LengthUnit::mm: return 1.0;
    case hal::LengthUnit::m: return 1e-3;
    case hal::LengthUnit::um: return 1e3;
  }
  return 1.0;
}
class DropOutlet final : public ScanOutlet {
 public:
  DropOutlet(DropAnswers drop, hal::LengthUnit unit, hal::ScanFormat format)
      : drop_(std::move(drop)), unit_(unit), format_(format) {}
  ~DropOutlet() override { drop_.remove_part(); }

  std::string pending(std::string& trouble) override { return drop_.pending(trouble); }
  Status put(std::vector<float>& xyz, std::size_t width, std::size_t height, double temperature_c) override {
    if (const auto scale = static_cast<float>(per_mm(unit_)); unit_ != hal::LengthUnit::mm)
      for (float& v : xyz) v *= scale;
    return hal::write_scan(drop_.part_path().c_str(), format_, xyz, width, height,
                           {.emulator = true, .block = 0, .scanner_temperature_c = temperature_c});
  }
  Status deliver(const std::string& name) override { return drop_.deliver(name, format_); }
  void give_up(const std::string& name) override { drop_.give_up(name); }

 private:
  DropAnswers drop_;
  hal::LengthUnit unit_;
  hal::ScanFormat format_;
};

class StreamOutlet final : public ScanOutlet {
 public:
  StreamOutlet(std::string host, std::uint16_t port) : gateway_(std::move(host), port) {}

  std::string pending(std::string& trouble) override {
    if (waiting_) return waiting_->name();
    if (const Status up = gateway_.connect(); !up) {
      trouble = up.error().text.view();
      return {};
    }
    waiting_ = gateway_.next_request(0, trouble);
    return waiting_ ? waiting_->name() : "";
  }
  Status put(std::vector<float>& xyz, std::size_t width, std::size_t height, double temperature_c) override {
    xyz_.swap(xyz);
    width_ = width;
    height_ = height;
    temperature_c_ = temperature_c;
    return success();
  }
  Status deliver(const std::string&) override {
    const std::int64_t utime_us =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    Status given = gateway_.answer(*waiting_, xyz_, width_, height_, utime_us, SIZE_MAX, true, temperature_c_);
    // After a lost connection slabd repeats the request on the next one, and the scan continues at the cut.
    for (int tries = 0; !given && given.error().code == Code::scanner_offline && tries < 5; ++tries) {
      std::string note;
      if (!gateway_.connect()) break;
      const auto again = gateway_.next_request(2'000, note);
      if (!again || again->name() != waiting_->name()) break;
      given = gateway_.answer(*again, xyz_, width_, height_, utime_us, SIZE_MAX, true, temperature_c_);
    }
    waiting_.reset();
    return given;
  }
  void give_up(const std::string&) override { waiting_.reset(); }

 private:
  StreamGateway gateway_;
  std::optional<StreamRequest> waiting_;
  std::vector<float> xyz_;
  std::size_t width_ = 0;
  std::size_t height_ = 0;
  double temperature_c_ = kNoValue;
};

}  // namespace

Result<std::unique_ptr<ScanOutlet>> open_outlet(const config::ArmSettings& arm, hal::ScanFormat format) {
  switch (arm.scanner_backend) {
    case hal::ScannerBackend::tcp: {
      const std::string_view host = arm.stream.host.view();
      return std::unique_ptr<ScanOutlet>(
          std::make_unique<StreamOutlet>(std::string(host == "0.0.0.0" ? "127.0.0.1" : host), arm.stream.port));
    }
    case hal::ScannerBackend::drop: break;
  }
  Result<DropAnswers> drop = DropAnswers::open(arm.scanner.drop_dir.c_str());
  if (!drop) return drop.error();
  return std::unique_ptr<ScanOutlet>(
      std::make_unique<DropOutlet>(std::move(drop.value()), arm.scanner.form.unit, format));
}

}  // namespace slabd::emulator
