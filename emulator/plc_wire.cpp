// SPDX-License-Identifier: Apache-2.0
#include "emulator/plc_wire.h"

#include <fmt/core.h>
#include <modbus.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <thread>

namespace slabd::simulate {
namespace {

struct ModbusFree {
  void operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
  }
};
using ModbusContext = std::unique_ptr<modbus_t, ModbusFree>;

struct MappingFree {
  void operator()(modbus_mapping_t* mapping) const { modbus_mapping_free(mapping); }
};

/// The PLC asks: a client on TCP, the master of a serial line.
class AskingWire : public PlcWire {
 public:
  AskingWire(const hal::PlcSettings& plc, std::string device) : plc_(plc), device_(std::move(device)) {}

  bool open() override {
    context_.reset(device_.empty()
                       ? modbus_new_tcp(host().c_str(), plc_.port)
                       : modbus_new_rtu(device_.c_str(), static_cast<int>(plc_.baud), parity(), 8, plc_.stop_bits));
    if (context_ == nullptr) return failed();
    modbus_set_slave(context_.get(), plc_.unit_id);
    modbus_set_response_timeout(context_.get(), 1, 0);
    return modbus_connect(context_.get()) == 0 || failed();
  }
  void close() override { context_.reset(); }
  bool read(hal::InputImage& image) override {
    const auto count = static_cast<int>(image.size());
    return context_ != nullptr &&
           (modbus_read_input_registers(context_.get(), 0, count, image.data()) == count || failed());
  }
  bool write(int first, int count, const hal::HoldingImage& image) override {
    return context_ != nullptr &&
           (modbus_write_registers(context_.get(), first, count, image.data() + first) == count || failed());
  }
  bool read_sync(std::uint16_t& value) override {
    return context_ != nullptr && (modbus_read_registers(context_.get(), 3, 1, &value) == 1 || failed());
  }
  std::string fault() const override {
    return fmt::format("{} ({}): {}; is slabd running with this config{}", name(),
                       device_.empty() ? "Modbus/TCP" : "Modbus RTU", modbus_strerror(fault_),
                       device_.empty() ? ", and is this address in [plc] allow?" : " at the other end of the line?");
  }
  std::string name() const override { return device_.empty() ? fmt::format("{}:{}", host(), plc_.port) : device_; }

 private:
  /// "0.0.0.0" is where a server listens, not where a client connects.
  [[nodiscard]] std::string host() const {
    const std::string_view listen = plc_.host.view();
    return listen.empty() || listen == "0.0.0.0" ? "127.0.0.1" : std::string(listen);
  }
  [[nodiscard]] char parity() const {
    switch (plc_.parity) {
      case hal::SerialParity::even: return 'E';
      case hal::SerialParity::odd: return 'O';
      case hal::SerialParity::none: return 'N';
    }
    return 'E';
  }
  bool failed() {
    fault_ = errno;
    return false;
  }

  hal::PlcSettings plc_;
  std::string device_;
  ModbusContext context_;
  int fault_ = 0;
};

/// slabd asks: both memories lie here, and a thread answers for them. One connection at a time, as a small PLC has.
class AskedWire : public PlcWire {
 public:
  AskedWire(const hal::PlcSettings& plc, ModbusContext context, int listener)
      : plc_(plc), context_(std::move(context)), listener_(listener), server_([this] { serve(); }) {}
  ~AskedWire() override {
    stop_ = true;
    server_.join();
    if (peer_ >= 0) ::close(peer_);
    ::close(listener_);
  }
  AskedWire(const AskedWire&) = delete;
  AskedWire& operator=(const AskedWire&) = delete;

  bool open() override { return true; }
  void close() override {}
  bool read(hal::InputImage& image) override {
    const std::lock_guard lock(mutex_);
    const std::uint16_t* const status = memory_->tab_registers + plc_.status_base;
    // Memory that nobody has written is no link.
    if (!connected_ || status[0] == 0) return false;
    std::copy_n(status, image.size(), image.begin());
    return true;
  }
  bool write(int first, int count, const hal::HoldingImage& image) override {
    const std::lock_guard lock(mutex_);
    std::copy_n(image.begin() + first, count, memory_->tab_registers + plc_.command_base + first);
    return true;
  }
  bool read_sync(std::uint16_t& value) override {
    const std::lock_guard lock(mutex_);
    value = memory_->tab_registers[plc_.command_base + 3];
    return true;
  }
  std::string fault() const override {
    return fmt::format("{}: slabd has not connected and written its registers; is it running with this config?",
                       name());
  }
  std::string name() const override { return fmt::format("{}:{}", plc_.host.view(), plc_.port); }

 private:
  void serve() {
    modbus_set_slave(context_.get(), plc_.unit_id);
    while (!stop_) {
      std::array<pollfd, 2> ready = {pollfd{listener_, POLLIN, 0}, pollfd{peer_, POLLIN, 0}};
      if (::poll(ready.data(), ready.size(), 50) <= 0) continue;
      if ((ready[0].revents & POLLIN) != 0) {
        drop_peer();
        peer_ = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      } else if (ready[1].revents != 0) {
        answer();
      }
    }
  }
  void answer() {
    std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
    modbus_set_socket(context_.get(), peer_);
    const int bytes = modbus_receive(context_.get(), request.data());
    if (bytes == 0) return;  // for another unit
    const std::lock_guard lock(mutex_);
    if (bytes < 0 || modbus_reply(context_.get(), request.data(), bytes, memory_.get()) < 0)
      drop_peer();
    else
      connected_ = true;
  }
  void drop_peer() {
    connected_ = false;
    if (peer_ >= 0) ::close(peer_);
    peer_ = -1;
  }

  hal::PlcSettings plc_;
  ModbusContext context_;
  std::unique_ptr<modbus_mapping_t, MappingFree> memory_{modbus_mapping_new(0, 0, 65'536, 0)};
  std::mutex mutex_;  ///< the registers
  int listener_;
  int peer_ = -1;
  std::atomic<bool> connected_{false};
  std::atomic<bool> stop_{false};
  std::thread server_;
};

}  // namespace

Result<std::unique_ptr<PlcWire>> make_plc_wire(const hal::PlcSettings& plc, const std::string& device) {
  if (plc.role != hal::PlcRole::client) return std::unique_ptr<PlcWire>(std::make_unique<AskingWire>(plc, device));
  ModbusContext context(modbus_new_tcp(plc.host.c_str(), plc.port));
  const int listener = context == nullptr ? -1 : modbus_tcp_listen(context.get(), 1);
  if (listener < 0)
    return error(Code::config, "the emulated PLC cannot listen at plc.connect %s:%u: %s", plc.host.c_str(),
                 unsigned{plc.port}, modbus_strerror(errno));
  return std::unique_ptr<PlcWire>(std::make_unique<AskedWire>(plc, std::move(context), listener));
}

}  // namespace slabd::simulate
