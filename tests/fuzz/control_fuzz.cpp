// SPDX-License-Identifier: Apache-2.0
//
// Input: a line on the control socket, and the same bytes as a change of calibrations.
#include "daemon/control/calibration_changer.h"
#include "daemon/loop.h"
#include "tests/fuzz/fuzz.h"
#include "tests/mock/mock.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;          // NOLINT(google-build-using-namespace)
  using namespace slabd::daemon;  // NOLINT(google-build-using-namespace)
  if (size > limits::kControlLineBytes) return 0;
  const std::string_view line = fuzz::text_of(data, size);
  hal::ManualClock clock;
  hal::MockNotify notify;
  hal::MockPlc plc;
  hal::MockPose pose;
  hal::MockScanner scanner{clock};
  const Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};
  static const auto station = std::make_unique<Station>(StationSettings{});
  static const auto actions = std::make_unique<Actions>();
  LoopFigures figures;
  CalibrationChanger changer("");
  const std::string answer = answer_control(line, *station, ports, figures, changer,
                                            [](const Event& event) { step(*station, event, *actions); });
  fuzz::must(answer.size() > 2 && answer.front() == '{' && answer.back() == '}', "an answer is one object");
  fuzz::must(answer.find('\n') == std::string::npos, "an answer is one line");
  const auto change = parse_change(line);
  if (change.ok()) {
    const std::string told = change_json(change.value());
    const auto again = parse_change(told);
    fuzz::must(again.ok() && change_json(again.value()) == told, "a change is written and read without loss");
  }
  return 0;
}
