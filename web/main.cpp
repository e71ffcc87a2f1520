// SPDX-License-Identifier: Apache-2.0
//
// slabd-web: serves the page and its documents. It reads the database through processes of slabctl, and the state of
// the line from the daemon's control socket. What quality writes (decisions, pins) goes through slabctl to slabd, too.
// slabd does not need it and does not wait for it.
#include <fmt/core.h>
#include <malloc.h>

#include <CLI/CLI.hpp>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "config/config.h"
#include "web/server.h"

namespace slabd::web {
namespace {

constexpr int kExitUsage = 2;
constexpr int kExitBadInput = 3;
constexpr int kExitUnreachable = 4;
/// Connections of one address: a kiosk's browser and tests share 127.0.0.1.
constexpr unsigned kKioskPerAddressMax = 32;
constexpr unsigned kLanPerAddressMax = 16;

void complain(const std::string& sentence) {
  fmt::print(stderr, "slabd-web: {}\n", sentence);
}

/// A folder of this process alone; deleted at the end.
class ReportsFolder {
 public:
  ReportsFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "slabd-web-XXXXXX").string();
    if (::mkdtemp(pattern.data()) != nullptr) path_ = pattern;
  }
  ~ReportsFolder() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  ReportsFolder(const ReportsFolder&) = delete;
  ReportsFolder& operator=(const ReportsFolder&) = delete;
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  std::string path_;
};

/// False after a complaint if the file cannot be read or is empty.
bool read_tls_file(const std::string& path, std::string& out) {
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();  // of a folder nothing is read, and errno has the reason
  out = text.str();
  if (!out.empty()) return true;
  complain(fmt::format("web.lan_listen does not open without its certificate and key: {}: {}", path,
                       errno != 0 ? std::strerror(errno) : "is empty"));
  return false;
}

/// Reads certificate and key of the LAN listener. False after a complaint.
bool read_tls(const config::WebSettings& web, ListenerSettings& out) {
  out.is_tls = true;
  return read_tls_file(web.tls_cert, out.certificate) && read_tls_file(web.tls_key, out.key);
}

std::string neighbour(const char* name) {
  std::error_code fault;
  const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", fault);
  return (self.parent_path() / name).string();
}

/// Opens a listener and reports its address; nullptr if it cannot be opened.
std::unique_ptr<Listener> opened(const ListenerSettings& settings, const char* name, Site& site) {
  auto listener = Listener::open(settings, site);
  if (!listener) {
    complain(std::string(listener.error().text.view()));
    return nullptr;
  }
  complain(fmt::format("{}: {}://{}:{}/{}", name, settings.is_tls ? "https" : "http", settings.host,
                       listener.value()->port(),
                       listener.value()->has_address() ? "" : " as soon as this computer has this address"));
  return std::move(listener.value());
}

int serve(const config::Config& config, const sigset_t& ends) {
  const config::WebSettings& web = config.web;
  ListenerSettings lan_settings{std::string(web.lan.host.view()), web.lan.port, kLanPerAddressMax};
  lan_settings.waits_for_address = true;
  if (!web.tls_cert.empty() && !read_tls(web, lan_settings)) return kExitBadInput;
  const ReportsFolder reports;
  if (reports.path().empty()) {
    complain("no folder for reports can be made in the folder for temporary files");
    return kExitUnreachable;
  }
  const std::string slabctl = web.slabctl.empty() ? neighbour("slabctl") : web.slabctl;
  if (::access(slabctl.c_str(), X_OK) != 0) {
    complain(slabctl + " cannot be executed, and it makes all documents");
    return kExitUnreachable;
  }
  Documents documents({slabctl, std::filesystem::absolute(config.path).string(), reports.path(), web.answer_s,
                       web.slabd_plant.empty() ? neighbour("slabd-plant") : web.slabd_plant, web.plant_dsn});
  Live live({config.control_socket, web.language, SLABD_VERSION}, documents);
  std::vector<std::string> scanners;
  for (const Arm& arm : config.arms.list) scanners.emplace_back(arm.scanner.view());
  Site site({web.names, web.users_file, web.viewer_login, config.storage.second_person,
             !config.plant.dsn.empty() || !web.plant_dsn.empty(), scanners},
            documents, live);
  const auto kiosk = opened({std::string(web.kiosk.host.view()), web.kiosk.port, kKioskPerAddressMax}, "kiosk", site);
  std::unique_ptr<Listener> lan;
  if (kiosk != nullptr && !web.lan.host.empty()) lan = opened(lan_settings, "lan", site);
  const bool good = kiosk != nullptr && (web.lan.host.empty() || lan != nullptr);
  int signal = 0;
  if (good) ::sigwait(&ends, &signal);
  documents.stop();  // before the listeners, whose threads may wait for a document
  return good ? 0 : kExitUnreachable;
}

int run(int argc, char** argv) {
  // Threads that end leave their memory to the next ones: two pools of malloc instead of eight for each processor.
  ::mallopt(M_ARENA_MAX, 2);
  sigset_t ends;
  ::sigemptyset(&ends);
  for (const int one : {SIGTERM, SIGINT}) ::sigaddset(&ends, one);
  ::sigprocmask(SIG_BLOCK, &ends, nullptr);  // all threads inherit it
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGHUP, SIG_IGN);

  CLI::App app("slabd-web: the page of slabd, the track-slab inspection daemon.", "slabd-web");
  std::string path = "/etc/slabd/slabd.toml";
  app.add_option("--config", path, "Configuration of slabd; slabd-web uses [web], [storage] db and [control] socket")
      ->capture_default_str();
  std::string plant_dsn;
  app.add_option("--plant", plant_dsn,
                 "Connection string of the plant's database for the plant page; default: [web] "
                 "plant_dsn, else [plant] dsn");
  app.set_version_flag("--version", std::string("slabd-web " SLABD_VERSION));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    return app.exit(fault) == 0 ? 0 : kExitUsage;
  }
  config::Config config;
  std::vector<config::Problem> problems;
  config::load_config(path, config, problems);
  problems.insert(problems.end(), config.web_problems.begin(), config.web_problems.end());
  for (const config::Problem& problem : problems) complain(problem.text);
  if (!problems.empty()) return kExitBadInput;
  if (!plant_dsn.empty()) config.web.plant_dsn = plant_dsn;
  return serve(config, ends);
}

}  // namespace
}  // namespace slabd::web

int main(int argc, char** argv) {
  try {
    return slabd::web::run(argc, argv);
  } catch (const std::exception& fault) {
    fmt::print(stderr, "slabd-web: internal error: {}\n", fault.what());
    return 5;
  }
}
