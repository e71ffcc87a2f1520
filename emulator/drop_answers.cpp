// SPDX-License-Identifier: Apache-2.0
#include "emulator/drop_answers.h"

#include <fmt/core.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

namespace slabd::simulate {

namespace fs = std::filesystem;

Result<DropAnswers> DropAnswers::open(const std::string& drop_dir) {
  DropAnswers answers;
  answers.request_dir_ = fs::path(drop_dir) / "request";
  answers.inbox_dir_ = fs::path(drop_dir) / "inbox";
  answers.part_path_ = fs::path(drop_dir) / fmt::format("emulated-scan-{}.part", ::getpid());
  std::error_code fault;
  const auto is_there = [&] {
    return fs::is_directory(answers.request_dir_, fault) && fs::is_directory(answers.inbox_dir_, fault);
  };
  // A daemon that has just been started makes them when it has read its database.
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(5);
  while (!is_there() && std::chrono::steady_clock::now() < until)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  if (!is_there())
    return error(Code::scanner_offline,
                 "%s has no request/ and inbox/: create the folder for slabd, which makes them, and start slabd first",
                 drop_dir.c_str());
  if (::access(answers.inbox_dir_.c_str(), W_OK | X_OK) != 0 || ::access(drop_dir.c_str(), W_OK | X_OK) != 0)
    return error(Code::scanner_offline, "%s cannot be written by this user: run as a member of the daemon's group",
                 drop_dir.c_str());
  for (const fs::directory_entry& entry : fs::directory_iterator(answers.request_dir_, fault))
    answers.answered_.insert(entry.path().stem());
  return answers;
}

std::string DropAnswers::pending(std::string& trouble) {
  std::error_code fault;
  for (const fs::directory_entry& entry : fs::directory_iterator(request_dir_, fault)) {
    if (entry.path().extension() != ".json") continue;
    const std::string name = entry.path().stem();
    if (answered_.contains(name)) continue;
    std::ifstream file(entry.path());
    const auto request = nlohmann::json::parse(file, nullptr, false);
    if (!request.is_object() || request.value("schema", "") != "slabd.scan_request/1") {
      trouble = fmt::format("{}: not a slabd.scan_request/1", entry.path().string());
      answered_.insert(name);
      continue;
    }
    return name;
  }
  return {};
}

Status DropAnswers::deliver(const std::string& name, hal::ScanFormat format) {
  answered_.insert(name);
  std::error_code fault;
  fs::rename(part_path_, inbox_dir_ / fmt::format("{}.{}", name, hal::extension(format)), fault);
  if (!fault) return success();
  return error(Code::scanner_offline, "cannot move a scan into %s: %s", inbox_dir_.c_str(), fault.message().c_str());
}

void DropAnswers::remove_part() const {
  std::error_code ignored;
  fs::remove(part_path_, ignored);
}

double per_mm(hal::LengthUnit unit) {
  switch (unit) {
    case hal::LengthUnit::mm: return 1.0;
    case hal::LengthUnit::m: return 1e-3;
    case hal::LengthUnit::um: return 1e3;
  }
  return 1.0;
}

}  // namespace slabd::simulate
