// SPDX-License-Identifier: Apache-2.0
//
// Input: a stream of Modbus/TCP frames as the server parses it, and the same bytes as a serial frame.
#include <algorithm>

#include "hal/plc/modbus_codec.h"
#include "tests/fuzz/fuzz.h"

using namespace slabd;       // NOLINT(google-build-using-namespace)
using namespace slabd::hal;  // NOLINT(google-build-using-namespace)

namespace {

void serve(std::span<const std::uint8_t> pdu, RegisterBank& bank) {
  const RequestCheck check = check_pdu(pdu);
  if (check.refusal) return;
  const HoldingImage before = bank.holding;
  std::array<std::uint8_t, kPduBytesMax> reply{};
  const std::size_t size = answer_pdu(pdu, bank, reply);
  fuzz::must(size >= 2 && size <= kPduBytesMax, "a reply has 2..253 bytes");
  fuzz::must(reply[0] == pdu[0], "a reply names the function");
  fuzz::must(check.writes || before == bank.holding, "only what is called a write changes a register");
  const bool command = !std::equal(before.begin() + 10, before.end(), bank.holding.begin() + 10);
  fuzz::must(check.writes_command || !command, "HR 10..39 change only by what is called a command");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::span<const std::uint8_t> stream(data, size);
  RegisterBank bank;
  while (stream.size() >= kMbapLengthEnd) {
    const auto bytes = frame_bytes(stream.first<kMbapLengthEnd>());
    if (!bytes || *bytes > stream.size()) break;
    const auto frame = stream.first(*bytes);
    if (!check_request(frame, 1).refusal) serve(frame.subspan(kMbapBytes), bank);
    stream = stream.subspan(*bytes);
  }
  const std::span<const std::uint8_t> serial(data, size);
  if (serial.size() >= kRtuBytesMin && serial.size() <= kRtuBytesMax)
    serve(serial.subspan(1, serial.size() - 1 - kRtuCrcBytes), bank);
  static_cast<void>(decode_inputs(bank.holding, WordOrder::abcd));
  return 0;
}
