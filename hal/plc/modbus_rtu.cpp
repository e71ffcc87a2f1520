// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <linux/serial.h>
#include <sys/ioctl.h>
#include <termios.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <utility>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/modbus_codec.h"
#include "hal/plc/plc_map.h"
#include "hal/plc/plc_notes.h"

// Problem: only silence separates frames on a serial line, and a computer measures silence badly. A USB adapter
// delivers bytes in bursts, and a busy loop reads late. Other slaves may share the line, and their answers look like
// requests.
// Idea: a request for slabd ends exactly with the newest byte and has a valid checksum. After silence any request is
// answered or refused. Directly after other bytes only requests that this map allows are accepted; random bytes match
// once in many years. A line that changes direction may add a byte or two of noise. A request after silence followed by
// such noise is accepted once silence has followed.
//   - only frames with slabd's own address are answered; broadcasts are ignored, and exception replies are not
//     requests;
// - next() returns after each write, so that the caller processes every state that the PLC has written;
// - nothing blocks; a device that disappears is closed and reopened once a second;
//   - no heap after construction.
namespace slabd::hal {
namespace {

/// Pause after which the rest of a frame is not expected any more. Longer than the delay of a USB adapter (16 ms) plus
/// one turn of the loop, and shorter than any master's retry time.
constexpr std::int64_t kPause_ns = ns_from_ms(60);
/// Interval of attempts to open a missing device.
constexpr std::int64_t kReopen_ns = kNsPerS;
/// Replies to other functions than FC 6 without an echo after which the adapter is assumed not to echo.
constexpr std::uint32_t kOthersToBeSure = 3;
/// Replies that are remembered because their echo may still come: 1.3 s of a PLC that asks every 20 ms.
constexpr std::size_t kRepliesKept = 64;
/// Age at which the echo of a reply counts as lost. Longer than the delay of any adapter or device server.
constexpr std::int64_t kEchoLost_ns = 10 * kNsPerS;
constexpr std::uint8_t kWriteOne = 6;
constexpr std::size_t kWriteOneBytes = 8;
/// Reads in one turn of the loop: the 4 kB of a terminal's buffer, so that noise cannot block the loop.
constexpr int kPiecesPerTurn = 16;
/// Time without a frame after which the master is assumed to be absent.
constexpr std::int64_t kSilent_ns = 2'500'000'000;

speed_t speed_of(std::uint32_t baud) {
  constexpr std::array<speed_t, kSerialBauds.size()> kSpeeds = {B1200,  B2400,  B4800,  B9600,
                                                                B19200, B38400, B57600, B115200};
  for (std::size_t i = 0; i < kSerialBauds.size(); ++i)
    if (kSerialBauds[i] == baud) return kSpeeds[i];
  return B0;
}

/// Sets the line to raw, 8 data bits, without flow control. Returns the setting that the device refused, empty if none.
FixedString<96> set_line(int fd, const PlcSettings& settings) {
  FixedString<96> refused;
  termios line{};
  if (tcgetattr(fd, &line) != 0) {
    refused.printf("it is not a serial line (%s)", errno_text(errno));
    return refused;
  }
  cfmakeraw(&line);
  line.c_cflag &= ~static_cast<tcflag_t>(CSIZE | PARENB | PARODD | CSTOPB | CRTSCTS);
  line.c_cflag |= CS8 | CREAD | CLOCAL;
  if (settings.parity != SerialParity::none) line.c_cflag |= PARENB;
  if (settings.parity == SerialParity::odd) line.c_cflag |= PARODD;
  if (settings.stop_bits == 2) line.c_cflag |= CSTOPB;
  // A character with a parity error becomes a 0 and fails the checksum, instead of being passed on.
  line.c_iflag &= ~static_cast<tcflag_t>(INPCK | IGNPAR);
  if (settings.parity != SerialParity::none) line.c_iflag |= INPCK;
  line.c_cc[VMIN] = 1;  // with O_NONBLOCK: no data is EAGAIN, and 0 bytes mean that the device is gone
  line.c_cc[VTIME] = 0;
  cfsetispeed(&line, speed_of(settings.baud));
  cfsetospeed(&line, speed_of(settings.baud));
  if (tcsetattr(fd, TCSANOW, &line) != 0)
    refused.printf("it does not take this speed and parity (%s)", errno_text(errno));
  if (refused.empty() && settings.rs485) {
    serial_rs485 direction{};
    direction.flags = SER_RS485_ENABLED | SER_RS485_RTS_ON_SEND;
    if (ioctl(fd, TIOCSRS485, &direction) != 0)
      refused.printf("its driver has no RS-485 mode (%s); plc.rs485 = false if the adapter switches by itself",
                     errno_text(errno));
  }
  tcflush(fd, TCIOFLUSH);
  return refused;
}

class RtuSlave final : public PlcPort {
 public:
  explicit RtuSlave(const PlcSettings& settings) : settings_(settings) {
    publish(PlcOutputs{});
    open_line();
  }

  std::size_t poll_fds(std::span<pollfd> fds) override {
    if (!fd_.is_open()) return 0;
    fds[0] = {fd_.get(), POLLIN, 0};
    return 1;
  }

  bool next(std::int64_t mono_ns, PlcInputs& inputs) override {
    now_ns_ = mono_ns;
    if (!fd_.is_open()) {
      if (now_ns_ >= reopen_ns_) open_line();
      return false;
    }
    bool written = bytes_ > 0 && now_ns_ - last_byte_ns_ > kPause_ns && end_with_pause();
    for (int piece = 0; !written && piece < kPiecesPerTurn && receive(); ++piece) written = serve();
    if (!written) return false;
    inputs = decode_inputs(bank_.holding, settings_.word_order);
    inputs.command_writer = opened_;
    inputs.command_writes = command_writes_;
    return true;
  }

  void publish(const PlcOutputs& outputs) override { encode_outputs(outputs, settings_.word_order, bank_.input); }
  std::size_t clients() const override {
    const bool heard = counters_.last_frame_ns != 0 && now_ns_ - counters_.last_frame_ns < kSilent_ns;
    return fd_.is_open() && heard ? 1 : 0;
  }
  const PlcLinkCounters& counters() const override { return counters_; }
  std::string_view trouble() const override { return trouble_.view(); }
  bool next_note(std::int64_t mono_ns, PlcNoteText& text) override { return notes_.next(mono_ns, counters_, "", text); }
  std::span<const std::uint16_t> holding() const override { return bank_.holding; }

 private:
  // ---- the device

  void open_line() {
    replies_ = {};
    other_replies_ = 0;
    has_echoed_ = false;
    reopen_ns_ = now_ns_ + kReopen_ns;
    Fd fd(open(settings_.device.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
    if (!fd.is_open()) {
      const char* cure = errno == EACCES ? "; add slabd to the group dialout" : "; is the adapter plugged in?";
      trouble_.printf("plc.device %s: %s%s", settings_.device.c_str(), errno_text(errno), cure);
      return;
    }
    const FixedString<96> refused = set_line(fd.get(), settings_);
    if (!refused.empty()) {
      trouble_.printf("plc.device %s: %s", settings_.device.c_str(), refused.c_str());
      return;
    }
    ioctl(fd.get(), TIOCEXCL);  // two programs on one line would answer twice
    trouble_.clear();
    fd_ = std::move(fd);
    bytes_ = 0;
    ++counters_.connections;
    ++opened_;
  }

  void lose_line(const char* why) {
    trouble_.printf("plc.device %s: %s; it is opened again when it is back", settings_.device.c_str(), why);
    fd_.reset();
    reopen_ns_ = now_ns_ + kReopen_ns;
  }

  /// Reads the bytes that have arrived and keeps the newest kRtuBytesMax. False if there are none.
  bool receive() {
    std::array<std::uint8_t, kRtuBytesMax> piece{};
    const ssize_t n = read(fd_.get(), piece.data(), piece.size());
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return false;
    if (n <= 0) {
      lose_line(n == 0 ? "the line was removed" : errno_text(errno));
      return false;
    }
    const auto count = static_cast<std::size_t>(n);
    if (bytes_ + count > buffer_.size()) {
      const std::size_t surplus = bytes_ + count - buffer_.size();
      std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(surplus),
                buffer_.begin() + static_cast<std::ptrdiff_t>(bytes_), buffer_.begin());
      bytes_ -= surplus;
      at_start_ = false;
    }
    if (bytes_ == 0) at_start_ = true;
    std::copy_n(piece.begin(), count, buffer_.begin() + static_cast<std::ptrdiff_t>(bytes_));
    bytes_ += count;
    last_byte_ns_ = now_ns_;
    return true;
  }

  /// Handles a pause after bytes that did not end as a request. Only bytes addressed to slabd are answered or counted,
  /// and after a longer silence they are not answered. True after a write.
  bool end_with_pause() {
    const std::span<const std::uint8_t> came = std::span(buffer_).first(std::exchange(bytes_, 0));
    if (!at_start_ || came[0] != settings_.unit_id) return false;
    const bool in_time = now_ns_ - last_byte_ns_ < 4 * kPause_ns;
    // Noise after a request: fewer bytes than any frame. This is checked first, because the checksum stays right if a 0
    // follows it.
    const std::size_t told = rtu_request_bytes(came);
    if (in_time && told != 0 && told <= came.size() && came.size() - told < kRtuBytesMin &&
        rtu_intact(came.first(told)))
      return carry_out(came.first(told), check_pdu(pdu_of(came.first(told))));
    if (in_time && is_unknown_request(came)) {
      refuse(came, ModbusException::illegal_function);
    } else {
      ++counters_.malformed;
    }
    return false;
  }

  /// True for an intact frame with a function that is not served, whose length is therefore unknown. Excludes exception
  /// replies: slabd's own may come back late, and refusing it would never end.
  static bool is_unknown_request(std::span<const std::uint8_t> frame) {
    constexpr std::uint8_t kRefusalBit = 0x80;
    return rtu_intact(frame) && (frame[1] & kRefusalBit) == 0 &&
           check_pdu(pdu_of(frame)).refusal == ModbusException::illegal_function;
  }

  // ---- frames

  /// Looks for a request that ends with the newest byte. True after a write.
  bool serve() {
    remove_echoes();
    for (std::size_t from = 0; from + kRtuBytesMin <= bytes_; ++from) {
      if (buffer_[from] != settings_.unit_id) continue;
      const auto frame = std::span<const std::uint8_t>(buffer_).subspan(from, bytes_ - from);
      if (rtu_request_bytes(frame) != frame.size() || !rtu_intact(frame)) continue;
      const RequestCheck check = check_pdu(pdu_of(frame));
      if (check.refusal && !(from == 0 && at_start_)) continue;
      bytes_ = 0;
      return carry_out(frame, check);
    }
    return false;
  }

  static std::span<const std::uint8_t> pdu_of(std::span<const std::uint8_t> frame) {
    return frame.subspan(1, frame.size() - 1 - kRtuCrcBytes);
  }

  /// Answers or refuses a request to slabd. True after a write.
  bool carry_out(std::span<const std::uint8_t> frame, const RequestCheck& check) {
    ++counters_.frames;
    counters_.last_frame_ns = now_ns_;
    if (check.refusal) {
      refuse(frame, *check.refusal);
      return false;
    }
    std::array<std::uint8_t, kPduBytesMax> pdu{};
    const std::size_t bytes = answer_pdu(pdu_of(frame), bank_, pdu);
    reply(std::span<const std::uint8_t>(pdu).first(bytes));
    if (check.writes_command) ++command_writes_;
    return check.writes;
  }
  void refuse(std::span<const std::uint8_t> frame, ModbusException exception) {
    ++counters_.exceptions;
    reply(exception_pdu(frame[1], exception));
  }

  void reply(std::span<const std::uint8_t> pdu) {
    std::array<std::uint8_t, kRtuBytesMax> frame{};
    frame[0] = settings_.unit_id;
    std::copy(pdu.begin(), pdu.end(), frame.begin() + 1);
    const std::size_t bytes = rtu_close(frame, 1 + pdu.size());
    remember(std::span<const std::uint8_t>(frame).first(bytes));
    if (write(fd_.get(), frame.data(), bytes) == static_cast<ssize_t>(bytes)) return;
    ++counters_.unsent;
    lose_line("a reply could not be written");
  }

  // ---- echoes
  //
  // Some adapters receive what they send. The reply to FC 6 equals its request, so its echo looks like the PLC's next
  // write of the same value. An echo that is taken for a request writes an old value again, is answered again, and
  // keeps the heartbeat of a stopped PLC alive. An adapter or a device server may delay an echo beyond the PLC's next
  // requests. Rules:
  // - Each reply has at most one echo, so each remembered reply removes at most one frame. If the PLC and an echo send
  //   the same bytes, the number of answers is right, whichever of the two frames comes first.
  // - Only the reply to FC 6 can be confused with a request. The echo of another reply proves that the adapter echoes.
  // - Echoes come back in the order of the replies. If a reply to FC 6 seems to come back, but the echoes of at least
  //   three other replies before it have not, the adapter does not echo, and the frame is a request.
  // - Until one of the two is known, the frame counts as an echo, because the PLC repeats a request without an answer.
  // - If the PLC repeated a write before the echo came, the repetition was removed instead of the echo, which must not
  //   write its old value after a newer request. By the order of echoes it may still come until a newer reply has come
  //   back. If the adapter is known to echo, one more such frame is removed until then.

  /// A reply whose echo may still come.
  struct Reply {
    std::array<std::uint8_t, kWriteOneBytes> head{};  ///< its first bytes: the whole reply to FC 6
    std::array<std::uint8_t, kRtuCrcBytes> crc{};     ///< its last bytes
    std::size_t bytes = 0;                            ///< 0: no reply yet
    int came = 0;                                     ///< frames taken for its echo
    std::uint32_t others_before = 0;                  ///< replies to other functions before it, on this line
    std::int64_t sent_ns = 0;

    [[nodiscard]] bool starts(std::span<const std::uint8_t> frame) const {
      if (bytes == 0 || frame.size() < bytes) return false;
      return std::equal(crc.begin(), crc.end(), frame.begin() + static_cast<std::ptrdiff_t>(bytes - crc.size())) &&
             std::equal(head.begin(), head.begin() + static_cast<std::ptrdiff_t>(std::min(bytes, head.size())),
                        frame.begin());
    }
    [[nodiscard]] bool is_request() const { return head[1] == kWriteOne; }
  };

  void remember(std::span<const std::uint8_t> frame) {
    Reply& reply = replies_[next_reply_];
    next_reply_ = (next_reply_ + 1) % replies_.size();
    reply = {};
    std::copy_n(frame.begin(), std::min(frame.size(), reply.head.size()), reply.head.begin());
    std::copy(frame.end() - kRtuCrcBytes, frame.end(), reply.crc.begin());
    reply.bytes = frame.size();
    reply.others_before = other_replies_;
    reply.sent_ns = now_ns_;
    if (!reply.is_request()) ++other_replies_;
  }

  /// Removes all echoes from the buffer, and noise of a change of direction directly before the first.
  void remove_echoes() {
    for (std::size_t from = 0; from + kRtuBytesMin <= bytes_;) {
      Reply* const reply = buffer_[from] == settings_.unit_id ? echo_at(from) : nullptr;
      if (reply == nullptr) {
        ++from;
        continue;
      }
      ++reply->came;
      const std::size_t end = from + reply->bytes;
      has_echoed_ = has_echoed_ || !reply->is_request();
      if (from < kRtuBytesMin) from = 0;
      std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(end),
                buffer_.begin() + static_cast<std::ptrdiff_t>(bytes_),
                buffer_.begin() + static_cast<std::ptrdiff_t>(from));
      bytes_ -= end - from;
    }
  }

  /// The oldest remembered reply that comes back at `from`; nullptr if the bytes there are not an echo.
  Reply* echo_at(std::size_t from) {
    const auto frame = std::span<const std::uint8_t>(buffer_).subspan(from, bytes_ - from);
    Reply* second = nullptr;
    for (std::size_t i = 0; i < replies_.size(); ++i) {
      Reply& reply = replies_[(next_reply_ + i) % replies_.size()];
      if (reply.came != 0) second = nullptr;  // a newer reply came back, so the echoes of older ones have come
      if (!reply.starts(frame)) continue;
      const bool cannot_echo = !has_echoed_ && reply.others_before >= kOthersToBeSure;
      if (reply.is_request() && (cannot_echo || now_ns_ - reply.sent_ns > kEchoLost_ns)) continue;
      if (reply.came == 0) return &reply;
      const bool is_newest = (i + 1) % replies_.size() == 0;
      if (has_echoed_ && reply.is_request() && reply.came == 1 && !is_newest) second = &reply;
    }
    return second;
  }

  PlcSettings settings_;
  Fd fd_;
  FixedString<limits::kErrorTextBytes> trouble_;
  std::uint32_t opened_ = 0;  ///< number of openings; one connection lasts from opening to loss

  std::array<std::uint8_t, kRtuBytesMax> buffer_{};
  std::size_t bytes_ = 0;
  bool at_start_ = true;                       ///< the buffer starts after a pause, or after a frame of slabd
  std::array<Reply, kRepliesKept> replies_{};  ///< a ring
  std::size_t next_reply_ = 0;                 ///< the oldest of the ring
  std::uint32_t other_replies_ = 0;            ///< replies to other functions than FC 6, on this line
  bool has_echoed_ = false;                    ///< one of those came back, on this line
  std::uint32_t command_writes_ = 0;

  RegisterBank bank_;
  PlcLinkCounters counters_;
  PlcNotes notes_;
  std::int64_t now_ns_ = 0;
  std::int64_t last_byte_ns_ = 0;
  std::int64_t reopen_ns_ = 0;
};

}  // namespace

Result<std::unique_ptr<PlcPort>> make_modbus_rtu(const PlcSettings& settings) {
  if (settings.unit_id < 1 || settings.unit_id > 247)
    return error(Code::config, "plc.unit_id is %u, allowed on a serial line is 1..247", unsigned{settings.unit_id});
  if (speed_of(settings.baud) == B0)
    return error(Code::config, "plc.baud is %u, allowed are 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200",
                 settings.baud);
  if (settings.device.empty()) return error(Code::config, "plc.device is missing: the serial line, such as /dev/ttyS0");
  return std::unique_ptr<PlcPort>(std::make_unique<RtuSlave>(settings));
}

}  // namespace slabd::hal
