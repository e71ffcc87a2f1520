// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/cli/stored_slab.h"
#include "tests/line/processes.h"
#include "tests/places/places.h"
#include "tests/places/wait.h"
#include "tests/web/http.h"

/// slabd-web as a process on a database with a slab, on ports that the kernel chose.
namespace slabd::web {

namespace fs = std::filesystem;
using nlohmann::json;

/// Port of the listener that slabd-web reported as "kiosk: http://127.0.0.1:41234/"; 0 if the process ended instead.
inline std::uint16_t reported_port(line::Process& process, const std::string& log, const std::string& name) {
  for (;;) {
    const bool running = process.running();
    const std::string text = line::read_file(log);
    const std::size_t at = text.find(name + ": http");
    const std::size_t colon = at == std::string::npos ? at : text.find(':', text.find("//", at) + 2);
    if (colon != std::string::npos && text.find('/', colon) != std::string::npos)
      return static_cast<std::uint16_t>(std::stoul(text.substr(colon + 1)));
    if (!running) return 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
}

class WebProcess : public cli::StoredSlab {
 protected:
  /// Ends the slab without scans: not measured.
  void store_slab() {
    begin();
    end();
  }
  [[nodiscard]] std::string config() const { return file("slabd.toml"); }
  [[nodiscard]] std::string socket() const { return file("control.sock"); }
  /// Writes slabd.toml with `web` as the rest of its table [web].
  void write_config(const std::string& web = "") const {
    fs::create_directories(file("recipes"));
    for (const auto& recipe : fs::directory_iterator(places::source_dir() + "/recipes"))
      if (const fs::path link = fs::path(file("recipes")) / recipe.path().filename(); !fs::is_symlink(link))
        fs::create_symlink(recipe.path(), link);
    static_cast<void>(
        write("slabd.toml",
              "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n[calibration]\nT_flange_scanner = [0, 0, 120, "
              "1, 0, 0, 0]\n[recipes]\ndir = \"" +
                  file("recipes") + "\"\n[storage]\ndb = \"" + db() + "\"\nspool_dir = \"" +
                  file("spool") + "\"\n[scanner]\ndrop_dir = \"" + file("drop") + "\"\n[control]\nsocket = \"" +
                  socket() + "\"\n[web]\nlisten = \"127.0.0.1:0\"\n" +
                  (web.find("answer_s = ") != std::string::npos ? "" : "answer_s = 60\n") +
                  (web.find("slabctl = ") != std::string::npos ? "" : "slabctl = \"" + places::slabctl() + "\"\n") +
                  "slabd_plant = \"" + places::slabd_plant() + "\"\n" + web));
  }
  void start(const std::string& web = "") {
    write_config(web);
    process_ = std::make_unique<line::Process>(std::vector<std::string>{places::slabd_web(), "--config", config()},
                                               file("web.out"), file("web.err"));
    port_ = reported_port(*process_, file("web.err"), "kiosk");
    ASSERT_NE(port_, 0) << log();
    if (web.find("lan_listen") != std::string::npos) lan_port_ = reported_port(*process_, file("web.err"), "lan");
  }
  [[nodiscard]] std::string log() const { return line::read_file(file("web.err")); }
  /// Waits until the log contains this text.
  [[nodiscard]] bool logs(const std::string& text) const {
    return places::wait_until([&] { return log().find(text) != std::string::npos; });
  }
  [[nodiscard]] Reply get(const std::string& target, const std::string& fields = "") const {
    return web::get(port_, target, fields);
  }
  /// The document at the target; expects status 200.
  [[nodiscard]] json document(const std::string& target) const {
    const Reply reply = get(target);
    EXPECT_EQ(reply.status, 200) << target << ": " << reply.body;
    return json::parse(reply.body, nullptr, false);
  }
  /// Expects an error document with this status, and returns its text.
  [[nodiscard]] std::string refused(const Reply& reply, int status) const {
    EXPECT_EQ(reply.status, status) << reply.body;
    const json error = json::parse(reply.body, nullptr, false);
    if (!error.is_object()) return "";
    EXPECT_EQ(error.value("schema", ""), "slabd.web_error/1");
    EXPECT_EQ(error.value("status", 0), status);
    return error.value("text", "") + "; " + error.value("cure", "");
  }
  /// Resident memory of the process.
  [[nodiscard]] long memory_kb() const {
    const std::string status = line::read_file("/proc/" + std::to_string(process_->pid()) + "/status");
    return std::strtol(status.c_str() + status.find("VmRSS:") + 6, nullptr, 10);
  }

  std::unique_ptr<line::Process> process_;
  std::uint16_t port_ = 0;
  std::uint16_t lan_port_ = 0;
};

}  // namespace slabd::web
