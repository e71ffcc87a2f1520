// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/select.h>
#include <sys/socket.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/modbus_client_plan.h"
#include "hal/plc/modbus_probe.h"
#include "hal/plc/plc_map.h"
#include "hal/plc/plc_notes.h"

// Problem: a client waits for a connection and for every answer, but the loop must not block.
// Idea: one thread owns the connection and executes the steps of ClientPlan; the loop exchanges whole images with it.
// Invariants:
//   - libmodbus does not repair a connection (recovery NONE). Its LINK mode loops endlessly if the peer is gone, and
//     after a late answer it assigns every further answer to the wrong request. On any error the connection is closed.
//   - Writes are not queued: there is one present image, and after a loss that image is written.
//   - The loop receives what the PLC has written in the order it was read; each change is an event.
//   - If one request is too short for the registers, they are written and read in pieces from the highest address down.
//     The words that announce new data (CMD_ACK, RES_SEQ; CMD_SEQ) are the last to be written and the first to be read.
//   - Every wait is bounded by `timeout_ns`, and no heap is used after construction.
namespace slabd::hal {
namespace {

/// Images read and not yet taken by the loop. Two would be enough, because the loop turns every 10 ms and a poll takes
/// longer.
constexpr std::size_t kUnreadMax = 8;
constexpr int kUnacknowledged_ms = 5000;
/// Losses of the same kind in a row after which they are reported as a property of the PLC.
constexpr int kHabit = 3;

struct ContextDeleter {
  void operator()(modbus_t* context) const {
    modbus_close(context);
    modbus_free(context);
  }
};

std::int64_t steady_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

bool is_exception(int error_number) {
  return error_number >= EMBXILFUN && error_number <= EMBXGTAR;
}

/// Registers that were read twice alike.
template <std::size_t First, std::size_t Count>
class Confirmed {
 public:
  /// Adds an answer. True if another one is needed before these registers count.
  bool confirm(const HoldingImage& read) {
    const auto now = std::span(read).template subspan<First, Count>();
    if (has_candidate_ && std::equal(now.begin(), now.end(), candidate_.begin())) {
      confirmed_ = candidate_;
      is_confirmed_ = true;
      return false;
    }
    std::copy(now.begin(), now.end(), candidate_.begin());
    has_candidate_ = true;
    return true;
  }
  /// Replaces them by those of the last two answers that agreed; zeros if none did.
  [[nodiscard]] bool is_confirmed() const { return is_confirmed_; }
  void put(HoldingImage& image) const { std::copy(confirmed_.begin(), confirmed_.end(), image.begin() + First); }

 private:
  std::array<std::uint16_t, Count> candidate_{};
  std::array<std::uint16_t, Count> confirmed_{};
  bool has_candidate_ = false;
  bool is_confirmed_ = false;
};

class Client final : public PlcPort {
 public:
  Client(const PlcSettings& settings, modbus_t* context, Fd news)
      : settings_(settings), context_(context), news_(std::move(news)), plan_(settings.poll_ns) {
    encode_outputs(PlcOutputs{}, settings_.word_order, present_);
    set_trouble("not connected yet");
    thread_ = std::thread([this] { run(); });
  }
  ~Client() override {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_one();
    thread_.join();
  }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // ---- called by the loop

  std::size_t poll_fds(std::span<pollfd> fds) override {
    fds[0] = {news_.get(), POLLIN, 0};
    return 1;
  }

  bool next(std::int64_t /*mono_ns*/, PlcInputs& inputs) override {
    const std::lock_guard lock(mutex_);
    counters_seen_ = counters_;
    trouble_seen_ = trouble_;
    if (unread_.empty()) {
      std::uint64_t count = 0;
      static_cast<void>(!::read(news_.get(), &count, sizeof count));  // clears the event; EAGAIN is fine too
      return false;
    }
    holding_seen_ = unread_.front().image;
    inputs = decode_inputs(holding_seen_, settings_.word_order);
    inputs.command_writer = unread_.front().connection;
    inputs.command_writes = unread_.front().number;
    inputs.gauges_known = unread_.front().gauges_known;
    unread_.pop();
    return true;
  }

  void publish(const PlcOutputs& outputs) override {
    InputImage image;
    encode_outputs(outputs, settings_.word_order, image);
    bool wake = false;
    {
      const std::lock_guard lock(mutex_);
      present_ = image;
      wake = waiting_ && plan_.next(steady_ns(), present_).step != ClientStep::wait;
    }
    if (wake) changed_.notify_one();
  }

  std::size_t clients() const override { return trouble_seen_.empty() ? 1 : 0; }
  const PlcLinkCounters& counters() const override { return counters_seen_; }
  std::string_view trouble() const override { return trouble_seen_.view(); }
  bool next_note(std::int64_t mono_ns, PlcNoteText& text) override {
    return notes_.next(mono_ns, counters_seen_, "", text);
  }
  std::span<const std::uint16_t> holding() const override { return holding_seen_; }

 private:
  using Trouble = FixedString<limits::kErrorTextBytes>;
  struct Unread {
    HoldingImage image{};
    std::uint32_t connection = 0;
    std::uint32_t number = 0;
    bool gauges_known = false;
  };

  // ---- the thread. plan_ and the written images belong to it; only publish() reads them, under the mutex.

  void run() {
    pthread_setname_np(pthread_self(), "slabd-plc");
    std::unique_lock lock(mutex_);
    while (!stop_) {
      const ClientPlan::Next next = plan_.next(steady_ns(), present_);
      if (next.step == ClientStep::wait) {
        waiting_ = true;
        changed_.wait_for(lock, std::chrono::nanoseconds(std::max<std::int64_t>(next.until_ns - steady_ns(), 0)));
        waiting_ = false;
        continue;
      }
      const InputImage image = present_;
      lock.unlock();
      HoldingImage read_image{};
      const bool done = carry_out(next.step, image, read_image);
      const int error_number = errno;
      lock.lock();
      note(next.step, done, error_number, image, read_image);
      if (useless_ < kHabit) continue;
      useless_ = 0;
      lock.unlock();
      const FixedString<160> fault = fault_of_answers(settings_);
      lock.lock();
      habit_ = fault;
    }
  }

  /// Executes one step with the PLC. If false, errno holds the reason.
  bool carry_out(ClientStep step, const InputImage& image, HoldingImage& read_image) {
    constexpr auto kAll = static_cast<int>(kInputRegisters);
    constexpr auto kHead = static_cast<int>(ClientPlan::kHeadRegisters);
    switch (step) {
      case ClientStep::connect: return connect();
      case ClientStep::write_all: return write(image, kAll, read_image);
      case ClientStep::write_head: return write(image, kHead, read_image);
      case ClientStep::read: return read(read_image);
      case ClientStep::wait: break;
    }
    return true;
  }

  bool connect() {
    answers_ = 0;
    modbus_close(context_.get());
    if (modbus_connect(context_.get()) != 0) return false;
    const int fd = modbus_get_socket(context_.get());
    if (fd >= FD_SETSIZE) {  // libmodbus waits with select()
      errno = EMFILE;
      return false;
    }
    const int on = 1;
    setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &kUnacknowledged_ms, sizeof kUnacknowledged_ms);
    return true;
  }

  /// Executes one request and its answer, over a new connection if the PLC closes it each time.
  template <typename Talk>
  bool exchange(const Talk& talk) {
    if (!settings_.keep_connection && answers_ > 0 && !connect()) return false;
    const bool done = talk();
    if (done) ++answers_;
    return done;
  }

  /// Start of the request that ends before `end`. Only the last request, from register 0 on, may hold several parts.
  [[nodiscard]] int piece_before(int end, int second_part, int third_part) const {
    const int most = settings_.registers_max;
    if (end <= most) return 0;
    return std::max(end > third_part ? third_part : end > second_part ? second_part : 0, end - most);
  }

  /// FC 23 reads all registers in one request, if the PLC allows as many.
  [[nodiscard]] bool reads_with_write() const {
    return settings_.read_write && read_count() <= settings_.registers_max;
  }

  bool write(const InputImage& image, int count, HoldingImage& read_image) {
    for (int end = count; end > 0;) {
      const int begin = piece_before(end, kRecordFirst, kTableFirst);
      const int base = settings_.status_base + begin;
      asked_ = {reads_with_write() && begin == 0 ? 23 : 16, end - begin};
      if (!exchange([&] {
            if (reads_with_write() && begin == 0)
              return modbus_write_and_read_registers(context_.get(), base, end, image.data(), settings_.command_base,
                                                     read_count(), read_image.data()) == read_count();
            return modbus_write_registers(context_.get(), base, end - begin, image.data() + begin) == end - begin;
          }))
        return false;
      end = begin;
    }
    return true;
  }

  bool read(HoldingImage& image) {
    for (int end = read_count(); end > 0;) {
      const int begin = piece_before(end, kCommandFirst, kGaugeFirst);
      asked_ = {3, end - begin};
      const auto talk = [&] {
        return modbus_read_registers(context_.get(), settings_.command_base + begin, end - begin,
                                     image.data() + begin) == end - begin;
      };
      if (!exchange(talk)) return false;
      end = begin;
    }
    return true;
  }

  /// Records the result of a step. Requires the mutex.
  void note(ClientStep step, bool done, int error_number, const InputImage& image, const HoldingImage& read_image) {
    const std::int64_t now_ns = steady_ns();
    if (!done) {
      lose(step, error_number, now_ns);
      return;
    }
    if (step == ClientStep::connect) {
      ++connection_;
      ++counters_.connections;
      fresh_ = true;
      command_ = {};
      gauges_ = {};
      plan_.connected(now_ns);
      return;
    }
    ++counters_.frames;
    counters_.last_frame_ns = now_ns;
    if (step == ClientStep::write_all) plan_.wrote_all(now_ns, image);
    if (step == ClientStep::write_head) plan_.wrote_head(now_ns, image);
    if (step != ClientStep::read && !reads_with_write()) return;
    plan_.has_read(now_ns);
    trouble_.clear();
    habit_.clear();
    useless_ = closed_behind_ = 0;
    const HoldingImage image_now = confirm_command(read_image, now_ns);
    const bool gauges_known = gauges_.is_confirmed();
    if (!fresh_ && image_now == last_read_ && gauges_known == gauges_known_) return;
    fresh_ = false;
    last_read_ = image_now;
    gauges_known_ = gauges_known;
    // The loop is blocked: the oldest states are lost, as with any late poll. Its own heartbeat stops then, and the PLC
    // detects that.
    if (unread_.full()) unread_.pop();
    static_cast<void>(unread_.push({image_now, connection_, ++delivered_, gauges_known}));
    raise();
  }

  /// Accepts a new command block, and new gauge values, only if two consecutive answers agree; the second is requested
  /// at once. A PLC may copy its memory into an answer while its program fills the block, so that half of it is from
  /// the previous command. Neither CMD_SEQ in last place nor the CRC, which ends before it, detects that. Until then
  /// the last confirmed block is returned.
  HoldingImage confirm_command(const HoldingImage& read, std::int64_t now_ns) {
    bool early = command_.confirm(read);
    // Gauges may change with every answer; a command does not wait for them.
    if (settings_.gauges) early = gauges_.confirm(read) || early;
    if (early && !read_again_) plan_.read_again(now_ns);
    read_again_ = early && !read_again_;  // requested once; what changes with every answer waits for the next poll
    HoldingImage image = read;
    command_.put(image);
    gauges_.put(image);
    return image;
  }

  void lose(ClientStep step, int error_number, std::int64_t now_ns) {
    modbus_close(context_.get());
    plan_.failed(now_ns);
    const bool closed = error_number == ECONNRESET || error_number == EPIPE || error_number == ECONNABORTED;
    if (step != ClientStep::connect) closed_behind_ = closed && answers_ == 1 ? closed_behind_ + 1 : 0;
    if (is_exception(error_number)) {
      ++counters_.exceptions;
    } else if (step != ClientStep::connect && error_number == ETIMEDOUT) {
      ++counters_.late;
      ++useless_;
    } else if (step != ClientStep::connect && error_number >= MODBUS_ENOBASE) {
      ++counters_.malformed;
      ++useless_;
    }
    if (closed_behind_ >= kHabit && settings_.keep_connection)
      habit_ =
          "the PLC closes the connection after each answer: plc.keep_connection = false opens one for each request";
    const char* doing = step == ClientStep::connect ? "connecting" : step == ClientStep::read ? "reading" : "writing";
    const Cure cure = cure_of(step, error_number);
    Trouble text;
    text.printf("plc.connect %s:%u: %s: %s%s%s", settings_.host.c_str(), unsigned{settings_.port}, doing,
                error_number >= MODBUS_ENOBASE ? modbus_strerror(error_number) : errno_text(error_number),
                habit_.empty() ? cure.c_str() : "; ", habit_.c_str());
    trouble_ = text;
    raise();
  }

  using Cure = FixedString<200>;

  /// Hint for the last request, which failed.
  [[nodiscard]] Cure cure_of(ClientStep step, int error_number) const {
    Cure cure;
    if (step == ClientStep::connect && !is_exception(error_number)) {
      cure = "; is its Modbus server running, and is the address right?";
    } else if (!is_exception(error_number)) {
      cure = "; the connection is made again";
    } else if (error_number == EMBXILFUN && asked_.function == 23) {
      cure = "; the PLC does not serve FC 23: plc.read_write = false writes with FC 16 and reads with FC 3";
    } else if (error_number == EMBXILFUN) {
      cure.printf("; the PLC does not serve FC %d: enable it in the PLC, or use another role (docs/PLC.md)",
                  asked_.function);
    } else if (error_number == EMBXILVAL && asked_.registers > kFewRegisters) {
      cure.printf("; are %d registers too many for one request? plc.registers_max = %s, see its manual",
                  asked_.registers, asked_.registers > kManyRegisters ? "100 or 48" : "48");
    } else if (error_number == EMBXILVAL) {
      cure.printf("; FC %d with %d registers is refused: see its manual for the largest request (plc.registers_max)",
                  asked_.function, asked_.registers);
    } else if (asked_.function == 3) {
      cure.printf("; does the PLC have %d holding registers from plc.command_base on, for unit plc.unit_id?",
                  read_count());
    } else {
      cure.printf("; does the PLC have 110 holding registers from plc.status_base on that may be written%s?",
                  asked_.function == 23 ? ", and those to read from plc.command_base on" : "");
    }
    return cure;
  }

  void set_trouble(const char* what) {
    trouble_.printf("plc.connect %s:%u: %s", settings_.host.c_str(), unsigned{settings_.port}, what);
    trouble_seen_ = trouble_;
  }

  void raise() {
    const std::uint64_t one = 1;
    static_cast<void>(!::write(news_.get(), &one, sizeof one));
  }

  [[nodiscard]] int read_count() const {
    return static_cast<int>(settings_.gauges ? kHoldingRegisters : kHoldingWithoutGauges);
  }
  static constexpr int kRecordFirst = 30;  ///< first registers of the parts: state, record, table
  static constexpr int kTableFirst = 64;
  static constexpr int kManyRegisters = 100;  ///< usual limits of PLCs for one request
  static constexpr int kFewRegisters = 48;
  struct Asked {
    int function = 0;
    int registers = 0;
  };

  const PlcSettings settings_;
  std::unique_ptr<modbus_t, ContextDeleter> context_;
  Fd news_;  ///< readable while there is news for the loop

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  bool stop_ = false;
  bool waiting_ = false;
  ClientPlan plan_;
  InputImage present_{};
  FixedQueue<Unread, kUnreadMax> unread_;
  HoldingImage last_read_{};
  bool fresh_ = true;          ///< no register was read on this connection yet
  bool gauges_known_ = false;  ///< of the last image that was delivered
  Confirmed<kCommandFirst, kGaugeFirst - kCommandFirst> command_;
  Confirmed<kGaugeFirst, kHoldingRegisters - kGaugeFirst> gauges_;
  Asked asked_;              ///< the last request; only the link's thread uses it
  int answers_ = 0;          ///< on this connection; used by the thread only
  int useless_ = 0;          ///< late or malformed answers since the last good one
  int closed_behind_ = 0;    ///< connections in a row that the PLC closed after their first answer
  FixedString<160> habit_;   ///< repeated misbehaviour of the PLC; "" = unknown
  bool read_again_ = false;  ///< the next answer was requested early
  std::uint32_t delivered_ = 0;
  std::uint32_t connection_ = 0;
  PlcLinkCounters counters_;
  Trouble trouble_;

  // The loop's own copies.
  PlcLinkCounters counters_seen_;
  Trouble trouble_seen_;
  HoldingImage holding_seen_{};
  PlcNotes notes_;

  std::thread thread_;  // last: starts when everything exists
};

Status check(const PlcSettings& settings) {
  in_addr address{};
  if (inet_pton(AF_INET, settings.host.c_str(), &address) != 1)
    return error(Code::config, "plc.connect: host \"%s\" is not an IPv4 address (such as 192.168.0.10)",
                 settings.host.c_str());
  if (settings.port == 0) return error(Code::config, "plc.connect: port 0, allowed 1..65535");
  if (settings.unit_id > 247 && settings.unit_id != 255)
    return error(Code::config, "plc.unit_id is %u, allowed 0..247 and 255", unsigned{settings.unit_id});
  const unsigned command = settings.command_base;
  const unsigned status = settings.status_base;
  const auto read = static_cast<unsigned>(settings.gauges ? kHoldingRegisters : kHoldingWithoutGauges);
  if (command + read > 65'536)
    return error(Code::config, "plc.command_base is %u, allowed 0..%u: %u registers begin there", command,
                 65'536 - read, read);
  if (status + kInputRegisters > 65'536)
    return error(Code::config, "plc.status_base is %u, allowed 0..65426: 110 registers begin there", status);
  if (command < status + kInputRegisters && status < command + read)
    return error(Code::config, "plc.command_base %u (%u registers) and plc.status_base %u (110 registers) overlap",
                 command, read, status);
  return success();
}

}  // namespace

Result<std::unique_ptr<PlcPort>> make_modbus_client(const PlcSettings& settings) {
  if (const Status checked = check(settings); !checked.ok()) return checked.error();
  Fd news(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  modbus_t* context = modbus_new_tcp(settings.host.c_str(), settings.port);
  if (!news.is_open() || context == nullptr) {
    modbus_free(context);
    return error(Code::internal, "the Modbus client cannot be set up: %s", errno_text(errno));
  }
  modbus_set_error_recovery(context, MODBUS_ERROR_RECOVERY_NONE);
  modbus_set_slave(context, settings.unit_id);
  const auto timeout_us = static_cast<std::uint32_t>(settings.timeout_ns / kNsPerUs);
  modbus_set_response_timeout(context, timeout_us / 1'000'000, timeout_us % 1'000'000);
  modbus_set_byte_timeout(context, 0, 0);  // the response timeout bounds the whole answer, also a slow one
  return std::unique_ptr<PlcPort>(std::make_unique<Client>(settings, context, std::move(news)));
}

Result<std::unique_ptr<PlcPort>> make_plc_port(const PlcSettings& settings) {
  switch (settings.role) {
    case PlcRole::client: return make_modbus_client(settings);
    case PlcRole::rtu: return make_modbus_rtu(settings);
    case PlcRole::server: break;
  }
  Result<std::unique_ptr<ModbusServer>> server = make_modbus_server(settings);
  if (!server) return server.error();
  return std::unique_ptr<PlcPort>(std::move(server.value()));
}

}  // namespace slabd::hal
