// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/wire.h"

#include <algorithm>

#include "tests/sim/allocation.h"

namespace slabd::sim {

std::int64_t Wire::next_of(const Queue& queue) {
  std::int64_t next = kNever;
  for (const Request& r : queue) next = std::min(next, r.at_ns);
  return next;
}

bool Wire::take_due(Queue& queue, std::int64_t now_ns, Request& out) {
  auto first = queue.end();
  for (auto at = queue.begin(); at != queue.end(); ++at)
    if (at->at_ns <= now_ns && (first == queue.end() || at->at_ns < first->at_ns)) first = at;
  if (first == queue.end()) return false;
  out = std::move(*first);
  queue.erase(first);
  return true;
}

void Wire::put(Queue& queue, std::uint32_t connection, Frame frame) {
  const std::int64_t at_ns = world_.now_ns + between(chance_, kMs / 2, 4 * kMs);
  if (world_.faulty(Fault::modbus_drop) && happens(chance_, 0.15)) return;
  if (world_.faulty(Fault::modbus_duplicate) && happens(chance_, 0.15))
    queue.push_back({at_ns + between(chance_, 0, happens(chance_, 0.3) ? 30 * kSecond : 300 * kMs), connection, frame});
  std::int64_t late_ns = 0;
  if (world_.faulty(Fault::modbus_reorder) && happens(chance_, 0.15)) late_ns = between(chance_, 5 * kMs, 90 * kMs);
  if (world_.faulty(Fault::modbus_delay) && happens(chance_, 0.2)) late_ns = between(chance_, 50 * kMs, 3 * kSecond);
  if (world_.faulty(Fault::modbus_garbage) && happens(chance_, 0.1))
    for (int i = 0; i < 3; ++i) frame[chance_.below(frame.size())] = static_cast<std::uint8_t>(chance_.next());
  queue.push_back({at_ns + late_ns, connection, std::move(frame)});
}

void Wire::send(std::uint32_t connection, Frame frame) {
  if (!listening_) return;
  if (world_.faulty(Fault::modbus_half_open) && dead_connection_ != connection && happens(chance_, 0.02))
    dead_connection_ = connection;
  if (world_.faulty(Fault::modbus_exception) && happens(chance_, 0.1)) {
    Frame refused(frame.begin(), frame.begin() + hal::kMbapBytes);
    refused.push_back(static_cast<std::uint8_t>(frame[hal::kMbapBytes] | 0x80U));
    refused.push_back(6);  // the gateway's exception: server device busy
    refused[4] = 0;
    refused[5] = 3;
    put(replies_, connection, std::move(refused));
    return;
  }
  // A gateway that has kept an old frame sends it again, on behalf of a connection.
  if (world_.faulty(Fault::modbus_stale_transaction) && !last_request_.empty() && happens(chance_, 0.1))
    put(requests_, happens(chance_, 0.5) ? connection : connection + 1'000'000, last_request_);
  if (happens(chance_, 0.2)) last_request_ = frame;
  put(requests_, connection, std::move(frame));
}

bool Wire::receive(std::uint32_t connection, Frame& frame) {
  Request reply;
  while (take_due(replies_, world_.now_ns, reply)) {
    if (reply.connection != connection) continue;  // of a connection that was abandoned
    frame = std::move(reply.frame);
    return true;
  }
  return false;
}

void Wire::listen(bool yes) {
  listening_ = yes;
  requests_.clear();
  replies_.clear();
  dead_connection_ = 0;
}

bool Wire::take(Request& request) {
  return take_due(requests_, world_.now_ns, request);
}

void Wire::answer(std::uint32_t connection, Frame frame) {
  if (connection == dead_connection_) return;
  if (world_.faulty(Fault::modbus_stale_transaction) && !last_reply_.empty() && happens(chance_, 0.1))
    put(replies_, connection, last_reply_);
  if (happens(chance_, 0.2)) last_reply_ = frame;
  put(replies_, connection, std::move(frame));
}

// ---- slabd's side -------------------------------------------------------------------------------------------------

bool SimPlcPort::serve(const Wire::Request& request) {
  const Frame& frame = request.frame;
  // A stream that has lost frame synchronisation is closed; here a frame without an answer represents that.
  const auto whole = hal::frame_bytes(std::span(frame).first<hal::kMbapLengthEnd>());
  if (!whole || *whole != frame.size()) {
    ++counters_.malformed;
    return false;
  }
  const hal::RequestCheck check = hal::check_request(frame, 1);
  Frame reply(frame.begin(), frame.begin() + hal::kMbapBytes);
  std::array<std::uint8_t, hal::kPduBytesMax> pdu{};
  std::size_t bytes = hal::kExceptionPduBytes;
  if (check.refusal) {
    ++counters_.exceptions;
    std::ranges::copy(hal::exception_pdu(frame[hal::kMbapBytes], *check.refusal), pdu.begin());
  } else {
    bytes = hal::answer_pdu(std::span(frame).subspan(hal::kMbapBytes), bank_, pdu);
  }
  reply[4] = static_cast<std::uint8_t>((bytes + 1) >> 8U);
  reply[5] = static_cast<std::uint8_t>((bytes + 1) & 0xFFU);
  reply.insert(reply.end(), pdu.begin(), pdu.begin() + static_cast<std::ptrdiff_t>(bytes));
  if (check.writes_command) command_writer_ = request.connection, ++command_writes_;
  wire_.answer(request.connection, std::move(reply));
  ++counters_.frames;
  return check.writes;
}

bool SimPlcPort::next(std::int64_t mono_ns, PlcInputs& inputs) {
  const heap::Aside aside;
  counters_.last_frame_ns = mono_ns;
  Wire::Request request;
  while (wire_.take(request)) {
    if (!serve(request)) continue;
    inputs = hal::decode_inputs(bank_.holding, hal::WordOrder::abcd);
    inputs.command_writer = command_writer_;
    inputs.command_writes = command_writes_;
    return true;
  }
  return false;
}

void SimPlcPort::publish(const PlcOutputs& outputs) {
  hal::InputImage image{};
  hal::encode_outputs(outputs, hal::WordOrder::abcd, image);
  if (image == bank_.input) return;
  bank_.input = image;
  const heap::Aside aside;
  shown_(outputs, image);
}

}  // namespace slabd::sim
