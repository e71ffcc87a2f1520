// SPDX-License-Identifier: Apache-2.0
#include "emulator/plc_peer.h"

#include <fmt/core.h>
#include <modbus.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <ctime>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/plc_map.h"

namespace slabd::emulator {
namespace {

/// Register exchange between the emulated PLC and slabd. Either the PLC is the client of slabd's server (TCP or serial
/// line), or slabd is the client and the PLC holds both memories. The PLC program is the same in both cases.
class PlcWire {
 public:
  virtual ~PlcWire() = default;
  /// Connects or reconnects. Returns false with the reason in fault().
  [[nodiscard]] virtual bool open() = 0;
  /// Disconnects, because a late answer would otherwise count as the answer to the next request.
  virtual void close() = 0;
  /// Reads IR 0..109. False: the link is broken, or slabd has not written yet.
  [[nodiscard]] virtual bool read(hal::InputImage& image) = 0;
  /// Writes `count` registers of `image` from HR `first` on.
  [[nodiscard]] virtual bool write(int first, int count, const hal::HoldingImage& image) = 0;
  /// Reads HR 3 as stored in the memory that slabd reads.
  [[nodiscard]] virtual bool read_sync(std::uint16_t& value) = 0;
  /// Reason for the failure of the last call, with a hint.
  [[nodiscard]] virtual std::string fault() const = 0;
  /// Address of slabd: "127.0.0.1:1502", "/dev/ttyS1".
  [[nodiscard]] virtual std::string name() const = 0;
};

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

/// The PLC as client: TCP, or the master of a serial line.
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
  /// Host to connect to; "0.0.0.0" is only valid for listening.
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

/// The PLC as server: it holds both memories, and a thread answers requests. One connection at a time, as on a small
/// PLC.
class AskedWire : public PlcWire {
 public:
  AskedWire(const hal::PlcSettings& plc, ModbusContext context, Fd listener)
      : plc_(plc), context_(std::move(context)), listener_(std::move(listener)), server_([this] { serve(); }) {}
  ~AskedWire() override {
    stop_ = true;
    server_.join();
  }
  AskedWire(const AskedWire&) = delete;
  AskedWire& operator=(const AskedWire&) = delete;

  bool open() override { return true; }
  void close() override {}
  bool read(hal::InputImage& image) override {
    const std::lock_guard lock(mutex_);
    const std::uint16_t* const status = memory_->tab_registers + plc_.status_base;
    // Memory that was never written counts as a broken link.
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
      std::array<pollfd, 2> ready = {pollfd{listener_.get(), POLLIN, 0}, pollfd{peer_.get(), POLLIN, 0}};
      if (::poll(ready.data(), ready.size(), 50) <= 0) continue;
      if ((ready[0].revents & POLLIN) != 0) {
        drop_peer();
        peer_ = Fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
      } else if (ready[1].revents != 0) {
        answer();
      }
    }
  }
  void answer() {
    std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
    modbus_set_socket(context_.get(), peer_.get());
    const int bytes = modbus_receive(context_.get(), request.data());
    if (bytes == 0) return;  // addressed to another unit
    const std::lock_guard lock(mutex_);
    if (bytes < 0 || modbus_reply(context_.get(), request.data(), bytes, memory_.get()) < 0)
      drop_peer();
    else
      connected_ = true;
  }
  void drop_peer() {
    connected_ = false;
    peer_.reset();
  }

  hal::PlcSettings plc_;
  ModbusContext context_;
  std::unique_ptr<modbus_mapping_t, MappingFree> memory_{modbus_mapping_new(0, 0, 65'536, 0)};
  std::mutex mutex_;  ///< guards the registers
  Fd listener_;
  Fd peer_;
  std::atomic<bool> connected_{false};
  std::atomic<bool> stop_{false};
  std::thread server_;
};

/// `plc`: the daemon's settings; this is the opposite end. `device`: the other end of the serial line (rtu only).
/// Code::config if the PLC's server cannot listen at plc.connect.
Result<std::unique_ptr<PlcWire>> make_plc_wire(const hal::PlcSettings& plc, const std::string& device) {
  if (plc.role != hal::PlcRole::client) return std::unique_ptr<PlcWire>(std::make_unique<AskingWire>(plc, device));
  ModbusContext context(modbus_new_tcp(plc.host.c_str(), plc.port));
  Fd listener(context == nullptr ? -1 : modbus_tcp_listen(context.get(), 1));
  if (!listener.is_open())
    return error(Code::config,
                 "the emulated PLC cannot listen at plc.connect %s:%u: %s; it must be a free address of this computer, "
                 "such as 127.0.0.1:1502",
                 plc.host.c_str(), unsigned{plc.port}, modbus_strerror(errno));
  return std::unique_ptr<PlcWire>(std::make_unique<AskedWire>(plc, std::move(context), std::move(listener)));
}

using std::chrono::milliseconds;

constexpr milliseconds kConnectTimeout{5'000};
constexpr milliseconds kAskedTimeout{12'000};  // as client slabd retries a lost PLC every five seconds
constexpr milliseconds kReconnectPeriod{500};
constexpr milliseconds kSessionTimeout{3'000};
constexpr int kControlRegisters = 4;  // HR 0..3

}  // namespace

struct PlcPeer::Impl {
  PlcTraits traits;
  const std::atomic<bool>* stop = nullptr;
  std::unique_ptr<PlcWire> wire;
  std::string name;

  PlcInputs memory;  // registers that this PLC provides to slabd
  PlcOutputs seen;
  std::vector<StoredResult> results;
  PlcClock::time_point beat_at{};
  PlcClock::time_point cycle_at{};

  // ---- the wire ---------------------------------------------------------------------------------------------------

  bool write_registers(int first, int count) {
    hal::HoldingImage image{};
    hal::encode_inputs(memory, traits.plc.word_order, true, image);
    return wire->write(first, count, image);
  }
  bool write_control() { return write_registers(0, kControlRegisters); }
  bool write_command() { return write_registers(hal::kCommandFirst, hal::kCommandLast - hal::kCommandFirst + 1); }

  // ---- one cycle --------------------------------------------------------------------------------------------------

  /// Runs one cycle: waits for its start, reads, acknowledges and sends the heartbeat. Reconnects a broken link.
  bool cycle(PlcTrouble& trouble) {
    std::this_thread::sleep_until(cycle_at + traits.cycle);
    cycle_at = PlcClock::now();
    if (stop->load()) {
      trouble.interrupted = true;
      trouble.text = "interrupted";
      return false;
    }
    hal::InputImage image{};
    if (!exchange(image)) return mend(trouble);
    return understand(image, trouble);
  }

  bool exchange(hal::InputImage& image) {
    if (!wire->read(image)) return false;
    if (PlcClock::now() - beat_at < traits.heartbeat) return true;
    ++memory.heartbeat;
    beat_at = PlcClock::now();
    return write_control();
  }

  bool understand(const hal::InputImage& image, PlcTrouble& trouble) {
    const Result<PlcOutputs> outputs = hal::decode_outputs(image, traits.plc.word_order);
    if (!outputs) {
      trouble.code = Code::config;
      trouble.text = fmt::format("{}: {}", name, outputs.error().text.view());
      return false;
    }
    seen = outputs.value();
    if (seen.result && hal::record_intact(image)) store_result();
    return true;
  }

  /// Stores the record before acknowledging it; slabd repeats it until it reads RES_ACK. A record that is already
  /// stored (same slab, station and command) is only acknowledged.
  void store_result() {
    const PlcResult& record = seen.record;
    const bool known = std::any_of(results.begin(), results.end(), [&](const StoredResult& stored) {
      return stored.record.slab_no == record.slab_no && stored.record.kind == record.kind &&
             stored.record.station == record.station && stored.record.cmd_seq == record.cmd_seq;
    });
    if (!known) results.push_back({record, PlcClock::now()});
    if (memory.res_ack == record.res_seq) return;  // sent with every heartbeat
    memory.res_ack = record.res_seq;
    write_control();  // the next cycle detects a failure, and the heartbeat repeats the write
  }

  /// Closes and reconnects after any error, because a late answer would otherwise count as the answer to the next
  /// request.
  bool mend(PlcTrouble& trouble) {
    const auto lost_at = PlcClock::now();
    while (PlcClock::now() - lost_at < traits.link_timeout && !stop->load()) {
      wire->close();
      hal::InputImage image{};
      if (wire->open() && write_control() && wire->read(image)) return understand(image, trouble);
      std::this_thread::sleep_for(kReconnectPeriod);
    }
    trouble.link_lost = true;
    trouble.text = fmt::format("{}: the connection was lost and not restored within {} s", name,
                               traits.link_timeout.count() / 1000);
    return false;
  }
};

PlcPeer::PlcPeer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
PlcPeer::~PlcPeer() = default;

const PlcOutputs& PlcPeer::seen() const {
  return impl_->seen;
}
const std::vector<StoredResult>& PlcPeer::results() const {
  return impl_->results;
}
std::string_view PlcPeer::peer_name() const {
  return impl_->name;
}

Result<std::unique_ptr<PlcPeer>> PlcPeer::connect(const PlcTraits& traits, const std::atomic<bool>& stop) {
  auto impl = std::make_unique<Impl>();
  impl->traits = traits;
  impl->stop = &stop;
  Result<std::unique_ptr<PlcWire>> wire = make_plc_wire(traits.plc, traits.device);
  if (!wire) return wire.error();
  impl->wire = std::move(wire.value());
  impl->name = impl->wire->name();
  const auto started = PlcClock::now();
  const milliseconds patience = traits.plc.role == hal::PlcRole::client ? kAskedTimeout : kConnectTimeout;
  std::uint16_t sync = 0;
  hal::InputImage image{};
  // A daemon that has just been started listens before it answers.
  while (!impl->wire->open() || !impl->wire->read(image) || !impl->wire->read_sync(sync)) {
    if (PlcClock::now() - started > patience || stop.load())
      return error(Code::scanner_offline, "%s", impl->wire->fault().c_str());
    std::this_thread::sleep_for(kReconnectPeriod);
  }

  PlcTrouble trouble;
  if (!impl->understand(image, trouble)) return error(Code::config, "%s", trouble.text.c_str());
  const std::uint16_t session_before = impl->seen.session;
  impl->memory.sync_req = static_cast<std::uint16_t>(sync + 1U);
  impl->memory.enable = true;
  ++impl->memory.heartbeat;
  if (!impl->write_control()) return error(Code::scanner_offline, "%s", impl->wire->fault().c_str());

  std::unique_ptr<PlcPeer> peer(new PlcPeer(std::move(impl)));
  const auto fresh = [&] {
    const PlcOutputs& seen = peer->seen();
    return seen.session != session_before && !seen.busy && seen.plc_link_ok;
  };
  if (!peer->await([&] { return fresh() || peer->seen().fault_present; }, kSessionTimeout + traits.acquire_timeout,
                   "a new session", trouble))
    return error(Code::scanner_offline, "%s", trouble.text.c_str());
  if (peer->seen().fault_present) {
    const auto fault = static_cast<Code>(peer->seen().fault);
    return error(fault, "slabd on %s reports fault %u: %.*s; %.*s", std::string(peer->peer_name()).c_str(),
                 peer->seen().fault, static_cast<int>(describe(fault).size()), describe(fault).data(),
                 static_cast<int>(cure(fault).size()), cure(fault).data());
  }
  return peer;
}

bool PlcPeer::await(const std::function<bool()>& done, milliseconds timeout, const char* what, PlcTrouble& trouble) {
  const auto started = PlcClock::now();
  while (!done()) {
    if (PlcClock::now() - started > timeout) {
      trouble.text =
          fmt::format("{}: waited {:.1f} s for {}", impl_->name, std::chrono::duration<double>(timeout).count(), what);
      return false;
    }
    if (!impl_->cycle(trouble)) return false;
  }
  return true;
}

/// Voids an unanswered order by requesting a new session, because the order may still be on its way.
void PlcPeer::make_void() {
  const std::uint16_t session = seen().session;
  ++impl_->memory.sync_req;
  impl_->write_control();  // repeated with every heartbeat
  PlcTrouble ignored;      // the caller reports the reason
  static_cast<void>(
      await([&] { return seen().session != session && !seen().busy; }, kSessionTimeout, "a new session", ignored));
}

bool PlcPeer::issue(const PlcOrder& order, std::uint16_t& cmd_seq, PlcTrouble& trouble, PlcClock::time_point* written) {
  trouble = {};
  PlcInputs& memory = impl_->memory;
  memory.command = static_cast<std::uint16_t>(order.command);
  memory.station = static_cast<std::uint16_t>(order.station);
  memory.slab_type = order.slab_type;
  memory.recipe = 0;
  memory.slab_no = order.slab_no;
  memory.mould = order.mould;
  memory.slab_temperature_dk = order.temperature_dk;
  memory.second_chip = order.second_chip.empty() ? std::uint16_t{0} : hal::second_chip_of(order.second_chip);
  memory.slab_id.fill('\0');
  std::copy_n(order.slab_id.begin(), std::min(order.slab_id.size(), memory.slab_id.size()), memory.slab_id.begin());

  for (int attempt = 0; attempt < kIssueAttempts; ++attempt) {
    memory.session_echo = seen().session;
    memory.cmd_seq = next_sequence(seen().cmd_ack);
    const std::uint16_t refused_before = seen().refused;
    auto written_at = PlcClock::now();
    if (attempt == 0 && written != nullptr) *written = written_at;
    impl_->write_command();  // the next cycle detects a failure as a lost link or a missing answer
    bool refused = false;
    for (int rewrites = 0;;) {
      if (!impl_->cycle(trouble)) return false;
      // Refusals are checked first, because CMD_ACK may have this number from another client's order.
      refused = seen().refused != refused_before && seen().refuse_seq == memory.cmd_seq &&
                (seen().refuse_code == static_cast<std::uint16_t>(Code::stale_session) ||
                 seen().refuse_code == static_cast<std::uint16_t>(Code::bad_sequence));
      if (refused || seen().cmd_ack == memory.cmd_seq || seen().session != memory.session_echo) break;
      if (PlcClock::now() - written_at < impl_->traits.ack_timeout) continue;
      if (rewrites++ == impl_->traits.ack_rewrites) {
        trouble.text = fmt::format("{}: command {} was not answered", impl_->name, memory.cmd_seq);
        make_void();
        return false;
      }
      written_at = PlcClock::now();
      impl_->write_command();  // the same number: if the first one arrived, slabd ignores this duplicate
    }
    if (refused || seen().cmd_ack != memory.cmd_seq) {
      // After a stale session or a wrong number, SESSION and CMD_ACK are read again. A session that is being written
      // to disk is shown when it is stored.
      if (!await([&] { return seen().ready; }, kSessionTimeout, "READY", trouble) &&
          (trouble.link_lost || trouble.interrupted || seen().fault_present))
        return false;
      trouble = {};
      continue;
    }
    cmd_seq = memory.cmd_seq;
    if (seen().cmd_status < kCommandFailed) return true;
    trouble.code = static_cast<Code>(seen().cmd_status - kCommandFailed);
    const bool later = trouble.code == Code::busy || trouble.code == Code::not_enabled;
    if (!later) {
      trouble.text = fmt::format("command {} refused, {}: {}; {}", cmd_seq, static_cast<unsigned>(trouble.code),
                                 describe(trouble.code), cure(trouble.code));
      return false;
    }
    PlcTrouble waiting;
    if (!await([&] { return !seen().busy && seen().plc_link_ok && seen().results_pending < 2; },
               impl_->traits.result_timeout, "not BUSY", waiting)) {
      trouble = waiting;
      return false;
    }
  }
  trouble.text = fmt::format("{}: command {} was refused {} times, last with {}", impl_->name, memory.cmd_seq,
                             kIssueAttempts, seen().refuse_code);
  return false;
}

bool PlcPeer::await_status(std::uint16_t cmd_seq, CommandStatus status, milliseconds timeout, PlcTrouble& trouble) {
  const auto reached = [&] {
    if (status == CommandStatus::acquired && seen().acq_seq == cmd_seq) return true;
    if (seen().cmd_ack != cmd_seq) return true;  // another client's order: checked below
    if (status == CommandStatus::acquired && seen().cmd_status < kCommandFailed) return false;  // ACQ_SEQ reports it
    return seen().cmd_status >= static_cast<std::uint16_t>(status);
  };
  if (!await(reached, timeout, status == CommandStatus::acquired ? "ACQUIRED" : "the command to be done", trouble))
    return false;
  if (status == CommandStatus::acquired && seen().acq_seq == cmd_seq) return true;
  if (seen().cmd_ack != cmd_seq) {
    trouble.code = Code::interrupted;
    trouble.text = fmt::format("command {} is not the one slabd works on", cmd_seq);
    return false;
  }
  if (seen().cmd_status < kCommandFailed) return true;
  trouble.code = static_cast<Code>(seen().cmd_status - kCommandFailed);
  trouble.text =
      fmt::format("{}: {}; {}", static_cast<unsigned>(trouble.code), describe(trouble.code), cure(trouble.code));
  return false;
}

const StoredResult* PlcPeer::result(std::uint32_t slab_no, int kind, int station, std::uint16_t cmd_seq) const {
  for (const StoredResult& stored : impl_->results) {
    const PlcResult& r = stored.record;
    if (r.slab_no == slab_no && r.kind == kind && r.station == station && r.cmd_seq == cmd_seq) return &stored;
  }
  return nullptr;
}

void PlcPeer::write_gauges(const std::array<std::int32_t, limits::kGaugesMax>& thousandths, std::uint32_t slab_no) {
  PlcInputs& memory = impl_->memory;
  // As a PLC after a cold start, but not with the numbers of the last run: slabd remembers those of the last slab.
  if (memory.gauge_seq == 0) memory.gauge_seq = static_cast<std::uint16_t>(std::time(nullptr) & 0x7FFF);
  memory.gauge_thousandths = thousandths;
  memory.gauge_slab_no = slab_no;
  memory.gauge_seq = next_sequence(memory.gauge_seq);
  constexpr int kCount = static_cast<int>(hal::kHoldingRegisters) - hal::kGaugeFirst;
  impl_->write_registers(hal::kGaugeFirst, kCount);
}

void PlcPeer::disable() {
  impl_->memory.enable = false;
  impl_->write_control();
}

}  // namespace slabd::emulator
