// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <functional>
#include <vector>

#include "hal/plc/modbus_codec.h"
#include "tests/sim/world.h"

/// Modbus/TCP between the PLC and slabd as frames, with a gateway in between that loses, repeats, delays, swaps and
/// corrupts them. On slabd's side the real codec and register map run on simulated connections.
namespace slabd::sim {

using Frame = std::vector<std::uint8_t>;

class Wire {
 public:
  explicit Wire(World& world) : world_(world), chance_(world.chance(7)) {}

  // ---- the PLC's side ----
  [[nodiscard]] std::uint32_t connect() { return ++connections_; }
  void send(std::uint32_t connection, Frame frame);
  /// The next reply that has arrived.
  [[nodiscard]] bool receive(std::uint32_t connection, Frame& frame);
  [[nodiscard]] std::int64_t next_reply_ns() const { return next_of(replies_); }

  // ---- slabd's side ----
  struct Request {
    std::int64_t at_ns = 0;
    std::uint32_t connection = 0;
    Frame frame;
  };
  /// Sets whether a process listens; data on their way to the previous process are lost.
  void listen(bool yes);
  [[nodiscard]] bool take(Request& request);
  void answer(std::uint32_t connection, Frame frame);
  [[nodiscard]] std::int64_t next_request_ns() const { return next_of(requests_); }

 private:
  using Queue = std::deque<Request>;
  static std::int64_t next_of(const Queue& queue);
  static bool take_due(Queue& queue, std::int64_t now_ns, Request& out);
  void put(Queue& queue, std::uint32_t connection, Frame frame);

  World& world_;
  Prng chance_;
  std::uint32_t connections_ = 0;
  std::uint32_t dead_connection_ = 0;  ///< half-open: answers on it are lost
  bool listening_ = false;
  Queue requests_;
  Queue replies_;
  Frame last_request_;
  Frame last_reply_;
};

class SimPlcPort final : public hal::PlcPort {
 public:
  /// `shown` is called with every image that differs from the previous one.
  SimPlcPort(Wire& wire, std::function<void(const PlcOutputs&, const hal::InputImage&)> shown)
      : wire_(wire), shown_(std::move(shown)) {}

  [[nodiscard]] std::size_t poll_fds(std::span<pollfd>) override { return 0; }
  [[nodiscard]] bool next(std::int64_t mono_ns, PlcInputs& inputs) override;
  void publish(const PlcOutputs& outputs) override;
  [[nodiscard]] std::size_t clients() const override { return 1; }
  [[nodiscard]] const hal::PlcLinkCounters& counters() const override { return counters_; }
  [[nodiscard]] std::string_view trouble() const override { return {}; }
  [[nodiscard]] bool next_note(std::int64_t, hal::PlcNoteText&) override { return false; }
  [[nodiscard]] std::span<const std::uint16_t> holding() const override { return bank_.holding; }

 private:
  bool serve(const Wire::Request& request);

  Wire& wire_;
  std::function<void(const PlcOutputs&, const hal::InputImage&)> shown_;
  hal::RegisterBank bank_;
  std::uint32_t command_writer_ = 0;
  std::uint32_t command_writes_ = 0;
  hal::PlcLinkCounters counters_;
};

}  // namespace slabd::sim
