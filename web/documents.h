// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/os.h"
#include "base/rate_limit.h"
#include "web/child.h"

/// Documents that slabctl makes, kept for a short time. Callers of one document share one process.
namespace slabd::web {

/// Processes of slabctl at once, one of them at most a report.
inline constexpr int kChildrenMax = 2;
/// Callers that wait for a process of their own; more are refused.
inline constexpr int kWaitingMax = 16;
/// Interval in which documents are made ahead, and the time after the last request in which that goes on.
inline constexpr double kAheadEvery_s = 300.0;
inline constexpr double kAheadFor_s = 86'400.0;
/// Documents kept, and their bytes. They are files in memory and count for MemoryMax of the unit.
inline constexpr std::size_t kKeptMax = 64;
inline constexpr std::uint64_t kKeptBytesMax = 32'000'000;

/// An answer to a browser, or the part of one.
struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::string etag;         ///< with quotes; empty for errors
  std::string text;         ///< the body unless `file` is open
  Fd file;                  ///< the body
  std::uint64_t bytes = 0;  ///< of `file`
};
using SharedAnswer = std::shared_ptr<const Answer>;

/// An answer with the document slabd.web_error/1.
[[nodiscard]] SharedAnswer error_answer(int status, const std::string& text, const std::string& cure);
/// An answer with this body and its ETag.
[[nodiscard]] SharedAnswer text_answer(std::string text, const std::string& type);
/// The body as a text.
[[nodiscard]] std::string body_of(const Answer& answer);

struct DocumentsSettings {
  std::string slabctl;
  std::string config;       ///< path, passed to slabctl as SLABD_CONFIG
  std::string reports_dir;  ///< private folder for reports until they are read
  double answer_s = 5.0;    ///< time limit of a process; of a report six times as much
  std::string plant;        ///< path of slabd-plant
  std::string plant_dsn;    ///< of the plant's database; empty: there is none, or that of the configuration
};

struct DocumentOrder {
  std::vector<std::string> arguments;
  double cache_s = 0.0;
  /// After cache_s the document is still given for this time, while it is made again: for documents about many slabs,
  /// which take seconds and which one slab hardly changes.
  double renew_s = 0.0;
  bool is_report = false;                     ///< the document is the file that "{file}" in the arguments names
  bool is_live = false;                       ///< of the poller: before all others that wait
  bool is_plant = false;                      ///< slabd-plant makes it
  bool is_ahead = false;                      ///< made without a caller: an error is not logged
  const char* file_type = "application/pdf";  ///< of a report
};

/// Callable from any thread.
class Documents {
 public:
  explicit Documents(DocumentsSettings settings);
  ~Documents();
  Documents(const Documents&) = delete;
  Documents& operator=(const Documents&) = delete;

  /// The document, or an answer with slabd.web_error/1: status 400 and 404 of slabctl's messages, 503 if a process is
  /// not available, 504 if it was late. Waits at most about three time limits.
  [[nodiscard]] SharedAnswer get(const DocumentOrder& order);
  /// Makes these documents now, and again every `every_s` seconds until a day after the last request, so that the first
  /// caller of a document that takes seconds does not wait. They begin only while no caller waits. Their renew_s must
  /// be longer than `every_s`. Call it once.
  void make_ahead(std::vector<DocumentOrder> orders, double every_s = kAheadEvery_s);
  /// The line has changed: documents that are kept for seconds only, and those that callers wait for, are made again.
  void note_change();
  /// Carries out a command that writes, one at a time. Status 200 with the document slabd.web_done/1, which contains
  /// the first line that it printed; else slabd.web_error/1: 400 and 409 refused, 404 no such slab, 503 slabd does not
  /// answer, or the command did not end by itself and may have made the change. The documents that are kept are made
  /// again afterwards.
  [[nodiscard]] SharedAnswer carry_out(const std::vector<std::string>& arguments);
  /// Kills the processes and refuses new orders.
  void stop();

 private:
  struct Entry {
    std::string name;  ///< the arguments
    SharedAnswer answer;
    std::chrono::steady_clock::time_point until;
    bool is_made = false;
    bool is_brief = false;    ///< kept for seconds only
    bool is_renewed = false;  ///< it is made again, or waits for that
    bool is_old = false;      ///< something was written while it is made: it may lack that
  };
  using Lock = std::unique_lock<std::mutex>;
  static constexpr auto kNeverAhead = std::chrono::steady_clock::time_point::max();

  [[nodiscard]] Entry* find(const std::string& name);
  [[nodiscard]] bool wait_for_process(Lock& lock, const DocumentOrder& order);
  [[nodiscard]] bool may_start(const DocumentOrder& order) const;
  /// Runs the process. The caller has waited for it; the lock is free meanwhile.
  [[nodiscard]] SharedAnswer run(Lock& lock, const DocumentOrder& order);
  void renew_documents();
  void order_ahead();
  /// A document that is old is kept for those only who asked before the write.
  void keep(const std::string& name, SharedAnswer answer, double cache_s);
  /// Waits for a document that another caller makes; nullopt if this caller must make it.
  [[nodiscard]] std::optional<SharedAnswer> wait_for_other(Lock& lock, const DocumentOrder& order);
  void log(const DocumentOrder& order, const Answer& answer);
  [[nodiscard]] SharedAnswer made(const DocumentOrder& order) const;

  const DocumentsSettings settings_;
  std::vector<std::string> environment_;
  Fd stop_;  ///< an eventfd, readable after stop()
  std::mutex writing_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::list<Entry> entries_;  ///< the last used first
  int running_ = 0;
  int reports_ = 0;
  int waiting_ = 0;  ///< callers, and documents that are made again; not those that are made ahead
  int live_waiting_ = 0;
  bool stopped_ = false;
  RateLimit log_limit_{10 * kNsPerS, 3};
  std::deque<DocumentOrder> to_renew_;  ///< each document once
  std::vector<DocumentOrder> ahead_;
  double ahead_every_s_ = kAheadEvery_s;
  std::chrono::steady_clock::time_point ahead_at_ = kNeverAhead;  ///< next time that `ahead_` is made
  std::chrono::steady_clock::time_point asked_at_;                ///< last request
  std::thread renewer_;                                           ///< last, because it uses the others
};

}  // namespace slabd::web
