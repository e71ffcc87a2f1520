// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "web/documents.h"

/// State of the line for all browsers: one thread asks the daemon's control socket once a second, another makes the
/// documents that belong to it when the status shows a change.
namespace slabd::web {

struct LiveSettings {
  std::string socket;    ///< the daemon's control socket
  std::string language;  ///< "en" or "zh"
  std::string version;
  /// Time limit for each step of a question; the daemon answers within milliseconds.
  int answer_ms = 1'000;
};

/// Callable from any thread.
class Live {
 public:
  /// Begins to ask. `documents` must live longer.
  Live(LiveSettings settings, Documents& documents);
  ~Live();
  Live(const Live&) = delete;
  Live& operator=(const Live&) = delete;

  /// slabd.web_status/1 with sentences in the language "en" or "zh". Composed at most every 200 ms for each language,
  /// so that callers share it. The age of a status grows while the daemon does not answer, or while its answer is not
  /// read.
  [[nodiscard]] SharedAnswer answer(const std::string& language);
  /// The daemon's answer to the verb "calibration", as the text of a JSON object; "null" if it did not answer. The
  /// question goes to the daemon at most once a second: callers share the answer, and wait while another one asks.
  [[nodiscard]] std::string calibration();

 private:
  using Clock = std::chrono::steady_clock;

  void poll();
  void poll_once();
  void refresh();
  void refresh_once(bool with_yield);
  /// The newest slabs and the map of the first of them; false if that slab ended between the two.
  [[nodiscard]] bool read_last(std::string& last, std::string& map, std::string& trouble);
  [[nodiscard]] std::string composed(bool in_chinese) const;
  /// The document as a JSON text without line ends; empty if it could not be made, and `trouble` has the reason then.
  [[nodiscard]] std::string document(const std::vector<std::string>& arguments, std::string& trouble);

  const LiveSettings settings_;
  Documents& documents_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool stopped_ = false;

  // The newest status and the trouble of the last question.
  std::string status_ = "null";
  Clock::time_point status_at_;
  bool reachable_ = false;
  std::string unreachable_ = "slabd has not been asked yet";
  /// Parts of the status that change when stored results change, and the same of the ended slab.
  std::string mark_;
  std::string last_slab_;

  // Documents that belong to it, JSON texts.
  std::string map_ = "null";
  std::string last_ = "[]";
  std::string yield_ = "null";
  std::string trouble_;

  struct Composed {
    SharedAnswer answer;
    Clock::time_point at;
  };
  std::array<Composed, 2> composed_;  ///< in English, in Chinese

  std::mutex asking_;        ///< of calibration(); held while one caller waits for the answer
  std::string calibration_;  ///< empty: not asked yet
  Clock::time_point calibration_at_;

  std::thread poller_;
  std::thread refresher_;
};

}  // namespace slabd::web
