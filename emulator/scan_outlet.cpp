// SPDX-License-Identifier: Apache-2.0
#include "emulator/scan_outlet.h"

#include <chrono>

#include "emulator/drop_answers.h"
#include "emulator/stream_gateway.h"

namespace slabd::simulate {
namespace {

class DropOutlet final : public ScanOutlet {
 public:
  DropOutlet(DropAnswers drop, hal::LengthUnit unit, hal::ScanFormat format)
      : drop_(std::move(drop)), unit_(unit), format_(format) {}
  ~DropOutlet() override { drop_.remove_part(); }

  std::string pending(std::string& trouble) override { return drop_.pending(trouble); }
  Status put(std::vector<float>& xyz, std::size_t width, std::size_t height) override {
    if (const auto scale = static_cast<float>(per_mm(unit_)); unit_ != hal::LengthUnit::mm)
      for (float& v : xyz) v *= scale;
    return hal::write_scan(drop_.part_path().c_str(), format_, xyz, width, height, {.emulator = true});
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
  Status put(std::vector<float>& xyz, std::size_t width, std::size_t height) override {
    xyz_.swap(xyz);
    width_ = width;
    height_ = height;
    return success();
  }
  Status deliver(const std::string&) override {
    const std::int64_t utime_us =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    Status given = gateway_.answer(*waiting_, xyz_, width_, height_, utime_us, SIZE_MAX, true);
    // A connection that was lost: slabd repeats the request on the next one, and the scan goes on where it was cut.
    for (int tries = 0; !given && given.error().code == Code::scanner_offline && tries < 5; ++tries) {
      std::string note;
      if (!gateway_.connect()) break;
      const auto again = gateway_.next_request(2'000, note);
      if (!again || again->name() != waiting_->name()) break;
      given = gateway_.answer(*again, xyz_, width_, height_, utime_us, SIZE_MAX, true);
    }
    waiting_.reset();
    return given;
  }
  void give_up(const std::string&) override { waiting_.reset(); }

 private:
  cli::StreamGateway gateway_;
  std::optional<cli::StreamRequest> waiting_;
  std::vector<float> xyz_;
  std::size_t width_ = 0;
  std::size_t height_ = 0;
};

}  // namespace

Result<std::unique_ptr<ScanOutlet>> open_outlet(const daemon::Config& config, hal::ScanFormat format) {
  if (config.scanner_backend == hal::ScannerBackend::tcp) {
    const std::string_view host = config.stream.host.view();
    return std::unique_ptr<ScanOutlet>(
        std::make_unique<StreamOutlet>(std::string(host == "0.0.0.0" ? "127.0.0.1" : host), config.stream.port));
  }
  Result<DropAnswers> drop = DropAnswers::open(config.scanner.drop_dir.c_str());
  if (!drop) return drop.error();
  return std::unique_ptr<ScanOutlet>(
      std::make_unique<DropOutlet>(std::move(drop.value()), config.scanner.unit, format));
}

}  // namespace slabd::simulate
